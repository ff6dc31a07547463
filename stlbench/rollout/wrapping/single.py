"""The Gymnasium wrapper of one environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.utils import RecordConstructorArgs

from stlbench.contract import Array, RewardMethod, Specification
from stlbench.errors import UsageError
from stlbench.rollout.wrapping.episodes import Episodes
from stlbench.rollout.wrapping.reading import place
from stlbench.rollout.wrapping.scoring import Scoring
from stlbench.rollout.wrapping.spaces import Observing, action_rows, check_actions

Info = dict[str, Any]
_ALL = np.array([0])


class StlWrapper(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """An environment that is paid and judged by a formula; `stlbench.wrap` makes it.

    Action, rendering and all other attributes are those of the environment.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], scoring: Scoring, observing: Observing) -> None:
        RecordConstructorArgs.__init__(self, scoring=scoring, observing=observing)
        gymnasium.Wrapper.__init__(self, env)
        check_actions(env.action_space)
        self._scoring, self._episodes, self._running = scoring, Episodes(scoring, 1), False
        self._observing, self.observation_space = observing, observing.space

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
            The observation with time and memory; the info with the entries of `step`, `signals` the first sample.
        """
        observation, info = self.env.reset(seed=seed, options=options)
        signals = self._scoring.reader.one(observation, info, 0)
        self._episodes.start(_ALL, signals)
        self._running = True
        return self._joined(observation), info | self._said(signals, 0.0, over=False)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, Info]:
        """One step of the environment, paid by the method.

        Returns:
            The observation with time and memory, the reward, whether the episode ended early, whether it is complete;
            and the info with `signals` (1, k), `t`, `env_reward`, the environment's own reward, `robustness` and
            `satisfied`, which are 0 and False before the end of the episode. All are of NumPy, each of one shape and
            dtype.
        """
        if not self._running:
            raise ResetNeeded("call reset() first: no episode is running")
        observation, own, terminated, truncated, info = _five(self.env.step(action))
        t, taken = int(self._episodes.t[0]) + 1, action_rows(action, 1)
        signals = self._scoring.reader.one(observation, info, t)
        reward = float(self._episodes.arrive(_ALL, signals, taken)[0])
        complete = t == self._episodes.steps
        over = bool(terminated or truncated or complete)
        if over:
            reward += self._episodes.left_out(0, taken)
            self._running = False
        early = bool(terminated or truncated) and not complete
        info = info | self._said(signals, _number(own, t), over)
        return self._joined(observation), reward, early or bool(terminated), complete, info

    def _joined(self, observation: Any) -> Any:
        return self._observing.join(observation, self._episodes.observe()[0], self._episodes.t)

    def _said(self, signals: Array, own: float, over: bool) -> Info:
        """The entries of the info.

        A truth is an array (), not a scalar: of scalars Gymnasium's vector environments make arrays of objects.
        """
        verdict = {name: values[0] for name, values in self._episodes.verdicts(np.array([over])).items()}
        said = {"signals": signals, "t": self._episodes.t[0], "env_reward": np.float64(own), **verdict}
        return said | {"satisfied": np.asarray(verdict["satisfied"])}


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
