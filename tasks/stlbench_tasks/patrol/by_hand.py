"""Features that a person made for policies on patrol."""

from __future__ import annotations

from stlbench_tasks.noisy_unicycle_by_hand import NoisyUnicycleByHand
from stlbench_tasks.patrol.system import Patrol


class PatrolByHand(NoisyUnicycleByHand, Patrol):
    pass
