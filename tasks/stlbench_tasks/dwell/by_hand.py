"""What a person made for policies to see of dwell."""

from __future__ import annotations

from stlbench_tasks.dwell.system import Dwell
from stlbench_tasks.noisy_unicycle_by_hand import NoisyUnicycleByHand


class DwellByHand(NoisyUnicycleByHand, Dwell):
    pass
