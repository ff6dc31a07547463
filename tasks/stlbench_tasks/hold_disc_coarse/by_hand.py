"""Features that a person made for policies on hold-disc-coarse: as on hold-disc."""

from __future__ import annotations

from stlbench_tasks.hold_disc.by_hand import HoldDiscByHand
from stlbench_tasks.hold_disc_coarse.system import HoldDiscCoarse


class HoldDiscCoarseByHand(HoldDiscByHand, HoldDiscCoarse):
    pass
