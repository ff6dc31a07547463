"""Whether the lander has crashed, which Gymnasium's environment does not say."""

from typing import Any

import gymnasium


class Crashes(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Adds `collision` to the info: 1 once the body has touched the ground, else 0."""

    def reset(self, **options: Any) -> tuple[Any, dict[str, Any]]:
        """As the environment's."""
        observation, info = self.env.reset(**options)
        return observation, info | {"collision": self._collision()}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """As the environment's."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return observation, reward, terminated, truncated, info | {"collision": self._collision()}

    def _collision(self) -> float:
        crashed: Any = getattr(self.env.unwrapped, "game_over", False)
        return float(crashed)
