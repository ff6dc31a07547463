"""Two environments from a user's own equations: a unicycle in a room, and two tanks with a pump and a valve."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.spaces import Box


class Unicycle(gymnasium.Env[Any, Any]):
    """Observes x, y, cos and sin of the heading. Acts by its speed, 0 to 1 m/s, and its turn; a step is 0.1 s."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}
    observation_space = Box(np.array([0, 0, -1, -1], np.float32), np.array([6, 6, 1, 1], np.float32))
    action_space = Box(np.array([0, -1.5], np.float32), np.array([1, 1.5], np.float32))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Somewhere near the corner (1, 1), with any heading."""
        super().reset(seed=seed)
        self.place = self.np_random.uniform(0.6, 1.4, 2)
        self.heading = self.np_random.uniform(-np.pi, np.pi)
        return self._seen(), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Drive along the heading, then turn; walls stop it."""
        speed, turn = np.clip(action, self.action_space.low, self.action_space.high)
        way = 0.1 * speed * np.array([np.cos(self.heading), np.sin(self.heading)])
        self.place = np.clip(self.place + way, 0, 6)
        self.heading += 0.1 * turn
        return self._seen(), 0.0, False, False, {}

    def _seen(self) -> Any:
        return np.array([*self.place, np.cos(self.heading), np.sin(self.heading)], np.float32)


class Tanks(gymnasium.Env[Any, Any]):
    """Observes two levels. A pump fills the first tank. A valve lets it run into the second, which leaks."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}
    observation_space = Box(0, 2, (2,), np.float32)
    action_space = Box(0, 1, (2,), np.float32)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Both levels from 0.3 to 0.7."""
        super().reset(seed=seed)
        self.levels = self.np_random.uniform(0.3, 0.7, 2)
        return self.levels.astype(np.float32), {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Torricelli's law for what flows out of each tank."""
        pump, valve = np.clip(action, 0, 1)
        first, second = np.sqrt(self.levels)
        change = [0.08 * pump - 0.06 * valve * first, 0.06 * valve * first - 0.03 * second]
        self.levels = np.clip(self.levels + change, 0, 2)
        return self.levels.astype(np.float32), 0.0, False, False, {}


gymnasium.register("OwnUnicycle-v0", Unicycle, max_episode_steps=400)
gymnasium.register("OwnTanks-v0", Tanks, max_episode_steps=400)
