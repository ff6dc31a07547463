"""DQN and TD3 of Stable-Baselines3 and of SBX, which is Stable-Baselines3 on JAX, in their usual setting.

That is one Gymnasium environment and the library's own loop, with one update of batch 128 after each step.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.noise import NormalActionNoise

from stlbench.contract import ActionBox, Environment

__all__ = ["sb3_training"]

_BOTH: dict[str, Any] = {"learning_rate": 1e-3, "buffer_size": 65536, "learning_starts": 0, "batch_size": 128}
_BOTH |= {"gamma": 0.95, "train_freq": 1, "gradient_steps": 1}
_DQN: dict[str, Any] = {"tau": 1.0, "target_update_interval": 1000, "policy_kwargs": {"net_arch": [128, 128]}}
_DQN |= {"exploration_initial_eps": 0.05, "exploration_final_eps": 0.05}
_TD3: dict[str, Any] = {"tau": 0.01, "policy_delay": 2, "target_policy_noise": 0.1, "target_noise_clip": 0.25}
_TD3 |= {"action_noise": NormalActionNoise(np.zeros(1), np.full(1, 0.2)), "policy_kwargs": {"net_arch": [64, 64]}}
_OPTIONS = {"DQN": _BOTH | _DQN, "TD3": _BOTH | _TD3}


class SingleEnv(gymnasium.Env[NDArray[np.float32], Any]):
    """One copy of a task, as `stlbench.gym.StlEnv` shows it, without the trace in the info."""

    def __init__(self, environment: Environment) -> None:
        assert environment.count == 1
        self._environment, actions = environment, environment.actions
        self.observation_space = Box(-np.inf, np.inf, (environment.observation_size,), np.float32)
        if isinstance(actions, ActionBox):
            self.action_space = Box(np.array(actions.low, np.float32), np.array(actions.high, np.float32))
        else:
            self.action_space = Discrete(actions.size)
        self._next: Any = None

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """The next episode, which the environment has begun by itself."""
        first = self._environment.reset() if self._next is None else self._next
        return first[0].astype(np.float32), {}

    def step(self, action: Any) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold one action."""
        came = self._environment.step(np.array([action]))
        self._next = came.observation
        return came.arrived[0].astype(np.float32), float(came.reward[0]), False, bool(came.ended[0]), {}


def sb3_training(library: str, agent: str, environment: Environment, steps: int) -> Callable[[], Any]:
    """A function that trains for `steps` more at each call, silently.

    Args:
        library: "stable_baselines3" or "sbx".
        agent: "DQN" or "TD3".
        environment: one copy.
    """
    torch.set_num_threads(1)
    kind = getattr(importlib.import_module(library), agent)
    model = kind("MlpPolicy", SingleEnv(environment), device="cpu", seed=0, **_OPTIONS[agent])
    model.set_logger(Logger(folder=None, output_formats=[]))
    return lambda: model.learn(steps, reset_num_timesteps=False, log_interval=steps)
