"""Several agents as one: a parallel environment of PettingZoo as an environment of Gymnasium with joint actions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete, Space

from stlbench.errors import UsageError
from stlbench.task.gym_calls import begun, stepped
from stlbench.task.gym_spaces import as_action


class JointEnv(gymnasium.Env[Any, Any]):
    """All agents of a parallel environment, in lock-step.

    The observation is a Dict, agent -> observation. The action joins the agents' actions. The info has the entries of
    each agent as `agent_entry`. An episode is over when all agents are over. An agent that is over before keeps its
    last observation and info, and gets no actions.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - declared so by Gymnasium

    def __init__(self, env: Any) -> None:
        """Args: `env` a PettingZoo `ParallelEnv`. Raises `UsageError` where actions of agents do not go together."""
        self.env, self._names = env, tuple(env.possible_agents)
        self.metadata = {"render_modes": list(getattr(env, "metadata", {}).get("render_modes", ()))}
        self.render_mode = getattr(env, "render_mode", None)
        self._spaces = {name: env.action_space(name) for name in self._names}
        self.observation_space = Dict({name: env.observation_space(name) for name in self._names})
        self.action_space = _joined(self._spaces)
        sizes = [int(np.prod(space.shape)) if isinstance(space, Box) else 1 for space in self._spaces.values()]
        self._ends = np.cumsum(sizes)[:-1].tolist()

    @property
    def unwrapped(self) -> Any:
        """The parallel environment, whose software is in the keys of cells."""
        return self.env.unwrapped

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        observations, infos = begun(self.env, seed=seed, options=options)
        self._last, self._infos = dict(observations), dict(infos)
        return dict(self._last), _flat(self._infos)

    def render(self) -> Any:
        return self.env.render()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step by a joint action (axes,); the reward is the sum of all agents'."""
        own = dict(zip(self._names, np.split(np.ravel(action), self._ends), strict=True))
        actions = {name: as_action(self._spaces[name], own[name]) for name in self.env.agents}
        observations, rewards, terminations, truncations, infos = stepped(self.env, actions)
        self._last |= observations
        self._infos |= infos
        over = not self.env.agents or all(terminations[name] or truncations[name] for name in terminations)
        return dict(self._last), float(sum(rewards.values())), over, False, _flat(self._infos)


def _joined(spaces: Mapping[str, Space[Any]]) -> Space[Any]:
    each: list[Any] = list(spaces.values())
    if all(isinstance(space, Box) for space in each):
        low, high = (np.concatenate([np.ravel(ends) for ends in side]) for side in zip(*map(_ends, each), strict=True))
        return Box(low, high)
    if all(isinstance(space, Discrete) for space in each):
        return MultiDiscrete([int(space.n) for space in each], start=[int(space.start) for space in each])
    named = ", ".join(map(str, each))
    raise UsageError(f"the actions of all agents should be Boxes, or all Discrete, they are {named}")


def _ends(space: Any) -> tuple[Any, Any]:
    return space.low.astype(np.float32), space.high.astype(np.float32)


def _flat(infos: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {f"{agent}_{name}": value for agent, info in infos.items() for name, value in info.items()}
