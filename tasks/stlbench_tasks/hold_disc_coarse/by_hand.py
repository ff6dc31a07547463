"""What a person made for policies to see of hold-disc-coarse: as of hold-disc."""

from __future__ import annotations

from stlbench_tasks.hold_disc.by_hand import HoldDiscByHand
from stlbench_tasks.hold_disc_coarse.system import HoldDiscCoarse


class HoldDiscCoarseByHand(HoldDiscByHand, HoldDiscCoarse):
    pass
