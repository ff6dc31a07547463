"""Gymnasium's Ant-v5 that walks round an obstacle to a place, F[0,300] & G[0,300], with a walk by hand; needs the
extra mujoco.
"""

from stlbench_tasks.ant_gait import AntWalk

_ABOVE, _BEYOND, _GOAL = (0.0, 1.8), (2.8, 1.8), (3.0, 0.0)
"""Way points round the obstacle, which is at 1.5, 0."""
_CLEAR, _PAST = 1.3, 2.4
"""The y from which it may pass, and the x from which it has passed."""


class AntAvoid(AntWalk):
    """Ant that reaches a place behind an obstacle, F[0,300] & G[0,300]; needs the extra mujoco."""

    def place(self, x: float, y: float, t: int) -> tuple[float, float]:
        if x >= _PAST:
            return _GOAL
        return _BEYOND if y >= _CLEAR else _ABOVE
