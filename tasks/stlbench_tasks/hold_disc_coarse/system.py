"""The robot of the comparative study as the authors' program samples it."""

from __future__ import annotations

from stlbench_tasks.hold_disc.system import HoldDisc


class HoldDiscCoarse(HoldDisc):
    """Comparative study at 0.1 s, the sampling time of the authors' program, where the paper says 0.01 s."""

    turn_step = 0.75
