"""The Gymnasium wrapper of one environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import RecordConstructorArgs

from stlbench.contract import Array, RewardMethod, Specification
from stlbench.errors import UsageError
from stlbench.wrapping.episodes import Episodes
from stlbench.wrapping.reading import place
from stlbench.wrapping.scoring import Scoring
from stlbench.wrapping.spaces import Observing, action_rows, check_actions

__all__ = ["StlWrapper"]

Info = dict[str, Any]
_ALL = np.array([0])


class StlWrapper(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """An environment that is paid and judged by a formula; `stlbench.wrap` makes it.

    Action, rendering and all other attributes are those of the environment.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], scoring: Scoring) -> None:
        RecordConstructorArgs.__init__(self, scoring=scoring)
        gymnasium.Wrapper.__init__(self, env)
        check_actions(env.action_space)
        self._scoring, self._episodes, self._running = scoring, Episodes(scoring, 1), False
        self._observing = Observing(env.observation_space, self._episodes.size)
        self.observation_space = self._observing.space

    @property
    def specification(self) -> Specification:
        """Formula in steps, signals, ranges, length of an episode."""
        return self._scoring.specification

    @property
    def method(self) -> RewardMethod:
        """The reward method."""
        return self._scoring.method

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Any, Info]:
        """Start an episode.

        Returns:
            The observation with time and memory; the info with `signals` (1, k), the first sample, and `t`, 0.
        """
        observation, info = self.env.reset(seed=seed, options=options)
        signals = self._scoring.reader.one(observation, info, 0)
        self._episodes.start(_ALL, signals)
        self._running = True
        return self._joined(observation), {**info, "signals": signals, "t": 0}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, Info]:
        """One step of the environment, paid by the method.

        Returns:
            The observation with time and memory, the reward, whether the episode ended early, whether it is complete;
            and the info with `signals` (1, k), `t` and `env_reward`, the environment's own reward. At the end of an
            episode it has `robustness` and `satisfied` too.
        """
        if not self._running:
            raise ResetNeeded("call reset() first: no episode is running")
        observation, own, terminated, truncated, info = _five(self.env.step(action))
        t, taken = int(self._episodes.t[0]) + 1, action_rows(action, 1)
        signals = self._scoring.reader.one(observation, info, t)
        reward = float(self._episodes.arrive(_ALL, signals, taken)[0])
        info = {**info, "signals": signals, "t": t, "env_reward": _number(own, t)}
        complete = t == self._episodes.steps
        if terminated or truncated or complete:
            reward += self._episodes.left_out(0, taken)
            info |= self._verdict()
            self._running = False
        early = bool(terminated or truncated) and not complete
        return self._joined(observation), reward, early or bool(terminated), complete, info

    def _joined(self, observation: Any) -> Any:
        return self._observing.join(observation, self._episodes.observe()[0], self._episodes.t)

    def _verdict(self) -> dict[str, float | bool | Array]:
        """As numbers; under `interval` as arrays (2,)."""
        found = {name: value[0] for name, value in self._episodes.verdicts(_ALL).items()}
        return {name: value if np.ndim(value) else value.item() for name, value in found.items()}


def _five(returned: Any) -> tuple[Any, Any, Any, Any, Info]:
    """What a step of an environment returns. Raises `UsageError` where it is something else."""
    if not isinstance(returned, tuple) or len(returned) != 5:
        given = f"{len(returned)} values" if isinstance(returned, tuple) else repr(returned)
        rule = "observation, reward, terminated, truncated, info"
        raise UsageError(f"step of the environment returned {given}; Gymnasium's have five: {rule}")
    return returned


def _number(own: Any, t: int) -> float:
    """The environment's own reward."""
    try:
        return float(own)
    except (TypeError, ValueError) as error:
        raise UsageError(f"the environment returned a reward that is no number {place(t, None)}: {own!r}") from error
