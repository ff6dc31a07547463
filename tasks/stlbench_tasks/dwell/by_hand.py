"""Features that a person made for policies on dwell."""

from __future__ import annotations

from stlbench_tasks.dwell.system import Dwell
from stlbench_tasks.noisy_unicycle_by_hand import NoisyUnicycleByHand


class DwellByHand(NoisyUnicycleByHand, Dwell):
    pass
