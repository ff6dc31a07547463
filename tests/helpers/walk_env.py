"""A walk on a line as a Gymnasium environment: x changes by -.5, 0 or .5 a step, and by chance where it is random.

Also wrapped, with a formula over x, and played from a given x.
"""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete

import stlbench
from stlbench.simulation.gymnasium.wrap import StlWrapper

LEFT, STAY, RIGHT = np.int64(0), np.int64(1), np.int64(2)


class Walk(gymnasium.Env[Any, Any]):
    """Terminates where x reaches `wall`. Its own reward is 7 a step. The info has `doubled`, 2 x, after each step."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 2}  # noqa: RUF012 - as Gymnasium has it

    def __init__(self, wall: float = np.inf, noise: float = 0.0, kind: str = "vector") -> None:
        self.render_mode = "rgb_array"
        self.wall, self.noise, self.kind, self.x = wall, noise, kind, 0.0
        line, mirror = Box(-50.0, 50.0, (2,), np.float32), Box(-50.0, 50.0, (1,), np.float32)
        places, picture = Dict({"place": line, "mirror": mirror}), Box(0, 255, (4, 4, 3), np.uint8)
        spaces = {"vector": line, "dict": places, "picture": picture}
        self.observation_space, self.action_space = spaces[kind], Discrete(3)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.x = self.np_random.uniform(-1, 1) * self.noise
        self.x = float((options or {}).get("x", self.x))
        return self._observe(), {"doubled": 2 * self.x}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.x += 0.5 * (int(action) - 1) + self.noise * self.np_random.normal()
        return self._observe(), 7.0, bool(self.x >= self.wall), False, {"doubled": 2 * self.x}

    def render(self) -> Any:
        return np.full((4, 4, 3), 100 + int(self.x), dtype=np.uint8)

    def _observe(self) -> Any:
        line = np.array([self.x, -self.x], dtype=np.float32)
        if self.kind == "dict":
            return {"place": line, "mirror": -line[:1]}
        return line if self.kind == "vector" else self.render()


BASE: dict[str, Any] = {"names": ("x", "minus"), "ranges": {"x": (-10, 10)}, "method": "raw"}


def wrapped(env: Walk | None = None, formula: str = "G[0,4] x <= 1", **options: Any) -> StlWrapper:
    return stlbench.wrap(env or Walk(), formula, **(BASE | {"steps": 4} | options))


def played(env: StlWrapper, *actions: Any, x: float = 0.0) -> list[tuple[Any, float, bool, bool, dict[str, Any]]]:
    env.reset(seed=0, options={"x": x})
    return [env.step(action) for action in actions]
