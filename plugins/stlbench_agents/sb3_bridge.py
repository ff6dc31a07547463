"""The bridge from stlbench.contract to Stable-Baselines3. Only training imports it, as SB3 takes seconds to import."""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Discrete
from numpy.typing import NDArray
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv

from stlbench.contract import ActionGrid, Array, Environment, Event, Integers
from stlbench_agents.replay import weighted_rewards

Single = NDArray[np.float32]
Info = dict[str, Any]


class CopiesVecEnv(VecEnv):
    """An `Environment` as SB3's `VecEnv`, which restarts by itself.

    SB3 bootstraps if an episode ends by the time limit. If a violation ended it, the last reward is the discounted sum
    of that reward for ever. A return that is cut while the episode goes on is reported as an end by the time limit.
    """

    def __init__(self, environment: Environment, gamma: float) -> None:
        self._environment, self._gamma = environment, gamma
        size, actions = (environment.observation_size,), environment.actions
        space = (
            Discrete(actions.size)
            if isinstance(actions, ActionGrid)
            else Box(np.array(actions.low, np.float32), np.array(actions.high, np.float32))
        )
        super().__init__(environment.count, Box(-np.inf, np.inf, size, np.float32), space)

    def reset(self) -> Single:
        return self._environment.reset().astype(np.float32)

    def step_async(self, actions: Integers | Array) -> None:
        self._actions = actions

    def step_wait(self) -> tuple[Single, Single, NDArray[np.bool_], list[Info]]:
        transition = self._environment.step(self._actions)
        infos: list[Info] = [{} for _ in range(self.num_envs)]
        for row in np.flatnonzero(transition.cut):
            last = transition.arrived[row].astype(np.float32)
            truncated = bool(transition.event[row] < Event.END)
            infos[row] = {"TimeLimit.truncated": truncated, "terminal_observation": last}
        reward = weighted_rewards(transition, self._gamma)
        return transition.observation.astype(np.float32), reward.astype(np.float32), transition.cut, infos

    def close(self) -> None:
        """Nothing to do."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """SB3 asks for `render_mode` alone: None."""
        if attr_name != "render_mode":
            raise AttributeError(attr_name)
        return [None for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        raise AttributeError(attr_name)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        raise AttributeError(method_name)

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        return [False for _ in self._get_indices(indices)]


class Checkpoints(BaseCallback):
    """Calls `report` at the `timesteps`, ascending, and at the end of training. Training stops if it answers True."""

    def __init__(self, timesteps: Iterable[int], report: Callable[[], bool]) -> None:
        super().__init__()
        self._left, self._report, self._enough = list(timesteps), report, False

    def _on_rollout_start(self) -> None:
        if self._left and self.num_timesteps >= self._left[0]:
            self._left = [timestep for timestep in self._left if timestep > self.num_timesteps]
            self._enough = self._report()

    def _on_step(self) -> bool:
        return not self._enough

    def _on_training_end(self) -> None:
        self._report()
