"""Gymnasium's Ant-v5 that walks between two places again and again, G[0,400] with F[0,200] of each, with a walk by
hand; needs the extra mujoco.
"""

from stlbench_tasks.ant_gait import AntWalk

_FIRST, _LEG = 60, 95
"""The step from which the second place is the aim, and the steps of each way between the two."""


class AntPatrol(AntWalk):
    """Ant that is at each of two places again and again, G[0,400] with F[0,200]; needs the extra mujoco."""

    def place(self, x: float, y: float, t: int) -> tuple[float, float]:
        return (1.0, 0.0) if t < _FIRST or (t - _FIRST) // _LEG % 2 else (-1.0, 0.0)
