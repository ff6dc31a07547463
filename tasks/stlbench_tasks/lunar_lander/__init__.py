"""Lunar lander that reaches its pad, stays there and does not crash, with a controller written by hand; needs the
extra field.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from stlbench.contract import GymTask

if TYPE_CHECKING:
    import gymnasium


class LunarLander(GymTask):
    """Lander that reaches its pad, stays there and does not crash, F[0,500] G[0,100]; needs the extra field."""

    def make(self) -> gymnasium.Env[Any, Any]:
        """The environment, with whether the body has touched the ground in the info."""
        import gymnasium  # at its first use: `stlbench list` works without it

        from stlbench_tasks.lunar_lander.crashes import Crashes

        name, mode = "LunarLanderContinuous-v3", self.render_mode
        return Crashes(gymnasium.make(name, max_episode_steps=-1, disable_env_checker=True, render_mode=mode))

    def controller(self, observation: Any, info: Mapping[str, Any], t: int) -> Sequence[float]:
        """Lean against the way to the pad, and fall the slower the nearer: throttle and side engines in [-1, 1]."""
        x, y, v_x, v_y, angle, omega, left, right = map(float, observation)
        if left and right:
            return -1.0 if v_y > -0.05 else 0.0, 0.0
        if left or right:
            return _within(-10 * v_y - 1), 0.0
        lean = max(-0.4, min(0.4, 0.55 * x + v_x))
        height = 0.55 * abs(x)
        return _within(10 * (height - y - v_y) - 1), _within(10 * (angle - lean) + 20 * omega)


def _within(number: float) -> float:
    """The nearest number in [-1, 1]."""
    return max(-1.0, min(1.0, number))
