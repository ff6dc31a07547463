"""An environment as a user may have it: a Dict observation, numbers in the info, and nothing that stlbench knows."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict


class Crossing(gymnasium.Env[Any, Any]):
    """A robot at (-4, y) crosses a road on which a truck goes up and down. The info says how far the truck is."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}
    observation_space = Dict({"robot": Box(-5, 5, (2,)), "truck": Box(-3, 3, (1,)), "truck_speed": Box(-1, 1, (1,))})
    action_space = Box(-1, 1, (2,))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """The robot on the left, the truck anywhere on the road."""
        super().reset(seed=seed)
        self.robot = np.array([-4.0, self.np_random.uniform(-1, 1)])
        self.truck, self.speed = self.np_random.uniform(-3, 3), self.np_random.choice([-0.2, 0.2])
        return self._seen()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """The robot moves by a fifth of the action; the truck turns at the ends of the road."""
        self.robot = np.clip(self.robot + 0.2 * np.clip(action, -1, 1), -5, 5)
        self.truck += self.speed
        if abs(self.truck) > 3:
            self.speed = -self.speed
            self.truck = float(np.clip(self.truck, -3, 3))
        seen, info = self._seen()
        return seen, 0.0, False, False, info

    def _seen(self) -> tuple[Any, dict[str, Any]]:
        far = float(np.hypot(self.robot[0], self.robot[1] - self.truck))
        observation = {
            "robot": self.robot.astype(np.float32),
            "truck": np.array([self.truck], np.float32),
            "truck_speed": np.array([self.speed], np.float32),
        }
        return observation, {"clearance": far}


gymnasium.register("Crossing-v0", Crossing, max_episode_steps=100)
