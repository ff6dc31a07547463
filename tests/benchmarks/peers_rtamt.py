"""A training as users of Stable-Baselines3 and rtamt write it: rewards are the online robustness of a requirement."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import gymnasium
import numpy as np
import rtamt
import stable_baselines3
from gymnasium.spaces import Box

__all__ = ["OnlineRobustness", "model"]


class OnlineRobustness(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Pays the least of the parts' robustness at each step; the observation also shows each part's, and the time."""

    def __init__(
        self,
        env: gymnasium.Env[Any, Any],
        parts: Sequence[str],
        names: Sequence[str],
        signals: Callable[[Any, Any], Any],
        steps: int,
    ) -> None:
        super().__init__(env)
        self.names, self.signals, self.steps = names, signals, steps
        self.trace: list[list[float]] = []
        self.monitors = [rtamt.StlDiscreteTimeOnlineSpecification() for _ in parts]
        for monitor, part in zip(self.monitors, parts, strict=True):
            for name in names:
                monitor.declare_var(name, "float")
            monitor.spec = part
            monitor.parse()
        assert env.observation_space.shape is not None
        size = env.observation_space.shape[0] + 1 + len(parts)
        self.observation_space = Box(-np.inf, np.inf, (size,), np.float32)

    def reset(self, **options: Any) -> tuple[Any, Any]:  # type: ignore[override]
        observation, info = self.env.reset(**options)
        for monitor in self.monitors if self.trace else ():  # rtamt cannot reset what it has not begun
            monitor.reset()
        self.t, self.trace = 0, []
        return self._shown(observation, self._robustness(observation, info)), info

    def step(self, action: Any) -> tuple[Any, float, bool, bool, Any]:
        observation, _, terminated, truncated, info = self.env.step(action)
        self.t += 1
        values = self._robustness(observation, info)
        # after an early end the last sample stays, so its robustness is paid for the steps that are left
        paid = min(values) * (1 + (self.steps - self.t if terminated else 0))
        return self._shown(observation, values), paid, terminated, truncated, info

    def _robustness(self, observation: Any, info: Any) -> list[float]:
        values: list[float] = []
        for sample in np.atleast_2d(self.signals(observation, info)).tolist():
            now = list(zip(self.names, sample, strict=True))
            values = [monitor.update(len(self.trace), now) for monitor in self.monitors]
            self.trace.append(sample)
        return values

    def _shown(self, observation: Any, values: Sequence[float]) -> Any:
        return np.concatenate([observation, [2 * self.t / self.steps - 1], values]).astype(np.float32)


def model(algorithm: str, env: OnlineRobustness, seed: int) -> Any:
    """PPO, SAC, TD3 or DQN with the default parameters; `.learn(steps)` trains it, `.predict(observation)` acts."""
    return getattr(stable_baselines3, algorithm)("MlpPolicy", env, seed=seed, device="cpu")
