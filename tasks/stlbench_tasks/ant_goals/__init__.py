"""Gymnasium's Ant-v5 that reaches two places in order, F[0,200] & F[200,400], with a walk by hand; needs the extra
mujoco.
"""

from stlbench_tasks.ant_gait import AntWalk

_SECOND = 200
"""The step from which the second place counts."""


class AntGoals(AntWalk):
    """Ant that reaches two places in order, F[0,200] & F[200,400]; needs the extra mujoco."""

    def place(self, x: float, y: float, t: int) -> tuple[float, float]:
        return (2.0, 0.0) if t < _SECOND else (2.0, 2.0)
