"""The comparative study at the sampling time of the authors' program. The system, and features that a person made
for its policies.
"""

from stlbench_tasks.hold_disc import HoldDisc, HoldDiscByHand


class HoldDiscCoarse(HoldDisc):
    """Comparative study at 0.1 s, the sampling time of the authors' program, where the paper says 0.01 s."""

    turn_step = 0.75


class HoldDiscCoarseByHand(HoldDiscByHand, HoldDiscCoarse):
    pass
