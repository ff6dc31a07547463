"""A task of several robots through PettingZoo's parallel API; `stlbench.parallel` documents it."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.spaces import Box, Discrete, Space
from gymnasium.utils import EzPickle
from numpy.typing import NDArray

from stlbench.contract import ActionGrid
from stlbench.errors import UsageError
from stlbench.simulation.gymnasium.env import StlEnv

try:
    from pettingzoo import ParallelEnv
except ImportError as error:
    raise UsageError(f'stlbench.parallel needs the extra multi: pip install "stlbench-rl[multi]" ({error})') from error

Single = NDArray[np.float32]
Info = dict[str, Any]


def parallel_env(task: str, method: str, *, scaled: bool = False) -> StlParallelEnv:
    """Make the environment of a task with a reward method; arguments and errors are those of `StlParallelEnv`."""
    return StlParallelEnv(task, method, scaled=scaled)


class StlParallelEnv(ParallelEnv[str, Single, Any], EzPickle):
    """The robots of one copy of a task. All start and end together: an episode is truncated at T, never terminated."""

    metadata: Info = {"name": "stlbench", "render_modes": []}  # noqa: RUF012 - declared so by PettingZoo
    render_mode: None = None

    def __init__(self, task: str, method: str, *, scaled: bool = False) -> None:
        """The reward is the mean of the method's reward over the `hold` steps of an action, in the paper's units.

        Args:
            task: its name.
            method: a reward method with or without parameters, "funnel" or "flag[beta=10]".
            scaled: divide rewards by the method's `scale`, as training in stlbench does.

        Raises:
            UsageError: no such task or method, a wrong parameter, or a task of one robot.
            Intractable, Unsuitable: the method does not fit the task (`stlbench.contract`).
        """
        EzPickle.__init__(self, task, method, scaled=scaled)
        self._env = StlEnv(task, method, scaled=scaled)
        self.task, self.method = self._env.task, self._env.method
        robots = self.task.file.robots
        if not robots:
            raise UsageError(f"task {task} has one robot; a task of several names them under 'robots' in its file")
        self.possible_agents = list(robots)
        self.agents: list[str] = []
        self.observation_spaces = dict.fromkeys(robots, self._env.observation_space)
        self.action_spaces = dict(zip(robots, self._spaces(), strict=True))

    def observation_space(self, agent: str) -> Space[Single]:
        """The view of a robot: the features of the joint state, the time, the method's inputs; the same for all."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space[Any]:
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: Info | None = None) -> tuple[dict[str, Single], dict[str, Info]]:
        """Start an episode, from a joint state that `seed` determines or from `options={"state": [...]}`.

        Returns:
            Each robot's observation (D,), and its info: `signals` (1, k), the trace's first sample, and `t`, 0.
            Options other than `state` are ignored, as PettingZoo's own checks ask.
        """
        state = {name: value for name, value in (options or {}).items() if name == "state"}
        observation, info = self._env.reset(seed=seed, options=state)
        self.agents = list(self.possible_agents)
        return self._each(observation), self._infos(info)

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Single], dict[str, float], dict[str, bool], dict[str, bool], dict[str, Info]]:
        """Hold one action of every robot for `hold` steps.

        Returns:
            Each robot's observation (D,), reward, False, whether the time limit is reached, and info. The info has
            `signals` (hold, k), the samples after each step, and `t`, the time of the last of them in steps.
        """
        if not self.agents:
            raise ResetNeeded("call reset() first: no episode is running")
        if set(actions) != set(self.agents):
            raise InvalidAction(f"an action is needed of each of {', '.join(self.agents)}, got {', '.join(actions)}")
        for name in self.agents:
            if not self.action_spaces[name].contains(actions[name]):
                raise InvalidAction(f"an action of {name} is in {self.action_spaces[name]}, got {actions[name]!r}")
        own = [actions[name] for name in self.agents]
        observation, reward, terminated, truncated, info = self._env.step(self._joint(own))
        returned = self._each(observation), self._each(reward), self._each(terminated), self._each(truncated)
        infos = self._infos(info)
        if truncated:
            self.agents = []
        return *returned, infos

    def _spaces(self) -> list[Space[Any]]:
        actions = self.task.actions
        if isinstance(actions, ActionGrid):
            return [Discrete(part.size) for part in actions.parts]
        low, high = np.array(actions.low, np.float32), np.array(actions.high, np.float32)
        ends = np.cumsum([0, *map(len, self.task.file.robots.values())]).tolist()
        return [Box(low[i:j], high[i:j]) for i, j in pairwise(ends)]

    def _joint(self, own: list[Any]) -> np.int64 | Single:
        """The action of `StlEnv` that all robots' own actions make."""
        actions = self.task.actions
        if isinstance(actions, ActionGrid):
            return np.int64(np.ravel_multi_index(own, [part.size for part in actions.parts]))
        return np.concatenate([np.asarray(each, np.float32) for each in own])

    def _each(self, value: Any) -> dict[str, Any]:
        return {name: np.copy(value) if isinstance(value, np.ndarray) else value for name in self.agents}

    def _infos(self, info: Info) -> dict[str, Info]:
        return {name: info | {"signals": info["signals"].copy()} for name in self.agents}
