"""Stable-Baselines3's DQN in its usual setting: one Gymnasium environment, its own loop."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray
from stable_baselines3 import DQN
from stable_baselines3.common.logger import Logger

from stlbench.contract import Environment

__all__ = ["sb3_dqn"]


class SingleEnv(gymnasium.Env[NDArray[np.float32], np.int64]):
    """One copy of a task, as `stlbench.gym.StlEnv` shows it, without the trace in the info."""

    def __init__(self, environment: Environment) -> None:
        assert environment.count == 1
        self._environment = environment
        self.observation_space = Box(-np.inf, np.inf, (environment.observation_size,), np.float32)
        self.action_space = Discrete(environment.actions.size)
        self._next: Any = None

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """The next episode, which the environment has begun by itself."""
        first = self._environment.reset() if self._next is None else self._next
        return first[0].astype(np.float32), {}

    def step(self, action: np.int64) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Hold one action."""
        came = self._environment.step(np.array([action]))
        self._next = came.observation
        return came.arrived[0].astype(np.float32), float(came.reward[0]), False, bool(came.ended[0]), {}


def sb3_dqn(environment: Environment, **options: Any) -> DQN:
    """The model, silent, in which `options` override the hyperparameters that all peers share."""
    torch.set_num_threads(1)
    shared: dict[str, Any] = {
        "learning_rate": 1e-3,
        "buffer_size": 65536,
        "learning_starts": 0,
        "batch_size": 128,
        "tau": 1.0,
        "gamma": 0.95,
        "train_freq": 1,
        "gradient_steps": 1,
        "target_update_interval": 1000,
        "exploration_initial_eps": 0.05,
        "exploration_final_eps": 0.05,
        "policy_kwargs": {"net_arch": [128, 128]},
    }
    model = DQN("MlpPolicy", SingleEnv(environment), device="cpu", seed=0, **(shared | options))
    model.set_logger(Logger(folder=None, output_formats=[]))
    return model
