"""The Gymnasium wrapper of a vector environment."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, iterate

from stlbench.contract import Array, RewardMethod, Specification, Truth
from stlbench.errors import UsageError
from stlbench.rollout.wrapping.episodes import Episodes
from stlbench.rollout.wrapping.rows import masked, row_of
from stlbench.rollout.wrapping.scoring import Scoring
from stlbench.rollout.wrapping.spaces import Observing, action_rows, check_actions

Info = dict[str, Any]


def autoreset_of(envs: gymnasium.vector.VectorEnv[Any, Any, Any]) -> AutoresetMode:
    """When the copies restart. Raises `UsageError` where a vector environment does not say it."""
    mode = envs.metadata.get("autoreset_mode")
    if not isinstance(mode, AutoresetMode):
        raise UsageError("the vector environment does not say when it restarts: metadata['autoreset_mode']")
    return mode


class StlVectorWrapper(gymnasium.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """A vector environment whose copies are paid and judged by a formula; `stlbench.wrap` makes it.

    It does what N copies of `StlWrapper` in a `gymnasium.vector.SyncVectorEnv` with the same autoreset mode do.
    """

    def __init__(self, env: gymnasium.vector.VectorEnv[Any, Any, Any], scoring: Scoring, observing: Observing) -> None:
        super().__init__(env)
        check_actions(env.single_action_space)
        self._scoring, self._episodes, self._mode = scoring, Episodes(scoring, env.num_envs), autoreset_of(env)
        self._observing, self.single_observation_space = observing, observing.space
        self.observation_space = batch_space(observing.space, env.num_envs)
        self._shape = env.num_envs, len(scoring.specification.signals)
        self._over, self._running = np.ones(env.num_envs, dtype=np.bool_), False

    @property
    def specification(self) -> Specification:
        """Formula in steps, signals, ranges, length of an episode."""
        return self._scoring.specification

    @property
    def method(self) -> RewardMethod:
        """The reward method."""
        return self._scoring.method

    def reset(self, *, seed: Any = None, options: Info | None = None) -> tuple[Any, Info]:
        """Start episodes in all copies, or in those of `options["reset_mask"]`; see `StlWrapper.reset`."""
        mask = np.array((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        observations, infos = self.env.reset(seed=seed, options=options)
        each, signals = list(iterate(self.env.observation_space, observations)), np.zeros(self._shape)
        for copy in np.flatnonzero(mask).tolist():
            signals[copy] = self._scoring.reader.one(each[copy], row_of(infos, copy), 0, copy)
        self._start(mask, signals)
        self._over, self._running = self._over & ~mask, True
        none = np.zeros(self.num_envs, dtype=np.bool_)
        return self._joined(observations), infos | self._said(signals, np.zeros(self.num_envs), none, mask)

    def step(self, actions: Any) -> tuple[Any, Array, Truth, Truth, Info]:
        """One step of each copy, see `StlWrapper.step`; copies restart when the vector environment has them do so.

        Under `AutoresetMode.SAME_STEP` what belongs to the end of an episode is in `final_obs` and `final_info`. Under
        `NEXT_STEP` a copy that restarts is paid 0.
        """
        if not self._running or (self._mode is AutoresetMode.DISABLED and self._over.any()):
            raise ResetNeeded("call reset() first: in some copy no episode is running")
        observations, own, terminations, truncations, infos = self.env.step(actions)
        same_step, taken = self._mode is AutoresetMode.SAME_STEP, action_rows(actions, self.num_envs)
        begun = self._over if self._mode is AutoresetMode.NEXT_STEP else np.zeros_like(self._over)
        ended = (terminations | truncations) & ~begun
        restarted = ended if same_step else begun
        signals = self._scoring.reader.many(observations, infos, np.where(restarted, 0, self._episodes.t + 1))
        last = self._last(signals, ended, infos) if same_step else signals
        rewards, complete = self._paid(~begun, last, taken)
        over = self._ended(ended, complete)
        own = np.where(begun, 0.0, np.asarray(own, dtype=np.float64))
        for row in np.flatnonzero(over).tolist():
            rewards[row] += self._episodes.left_out(row, taken[[row]])
        if same_step and over.any():
            infos = self._finals(infos, self._said(last, own, over, over), over)
            own = np.where(over, 0.0, own)
        judged = over & ~restarted
        self._start(restarted, signals)
        self._over = over
        infos = infos | self._said(signals, own, judged, np.ones_like(over))
        return self._joined(observations), rewards, over & (terminations | ~complete), complete, infos

    def _last(self, signals: Array, ended: Truth, infos: Info) -> Array:
        """The signals at which this step arrived, in place of those after a restart in the same step."""
        last = signals.copy()
        if ended.any() and "final_obs" not in infos:
            raise UsageError("the vector environment restarts in the same step, but its info has no final_obs")
        for copy in np.flatnonzero(ended).tolist():
            info, t = row_of(infos.get("final_info", {}), copy), int(self._episodes.t[copy]) + 1
            last[copy] = self._scoring.reader.one(infos["final_obs"][copy], info, t, copy)
        return last

    def _paid(self, going: Truth, last: Array, taken: Array) -> tuple[Array, Truth]:
        """The rewards (N,), 0 for a copy that begins, and which copies have arrived at the last step."""
        rewards, rows = np.zeros(self.num_envs), np.flatnonzero(going)
        rewards[rows] = self._episodes.arrive(rows, last[rows], taken[rows])
        return rewards, going & (self._episodes.t == self._episodes.steps)

    def _ended(self, ended: Truth, complete: Truth) -> Truth:
        """The copies whose episode is over."""
        if self._mode is not AutoresetMode.DISABLED and (late := complete & ~ended).any():
            rule = f"goes on after step {self._episodes.steps}; steps should be its time limit"
            raise UsageError(f"the vector environment restarts by itself, but copy {late.argmax()} {rule}")
        return ended | complete

    def _finals(self, infos: Info, said: Info, over: Truth) -> Info:
        """The infos with what belongs to the end of episodes that are over, before their copies restart."""
        shown, final_obs = self._episodes.observe(), np.full(self.num_envs, None, dtype=object)
        for row in np.flatnonzero(over).tolist():
            final_obs[row] = self._observing.join(infos["final_obs"][row], shown[row], self._episodes.t[[row]], row)
        finals = {"final_obs": final_obs, "final_info": infos.get("final_info", {}) | said}
        return infos | finals | {"_final_obs": over.copy(), "_final_info": over.copy()}

    def _start(self, which: Truth, signals: Array) -> None:
        rows = np.flatnonzero(which)
        if len(rows):
            self._episodes.start(rows, signals[rows])

    def _said(self, signals: Array, own: Array, over: Truth, which: Truth) -> Info:
        """The entries of `StlWrapper`, of some of the copies (N,); those whose episodes are over are judged."""
        said = {"signals": signals[:, None], "t": self._episodes.t, "env_reward": own} | self._episodes.verdicts(over)
        return {key: value for name, values in said.items() for key, value in masked(name, values, which).items()}

    def _joined(self, observations: Any) -> Any:
        return self._observing.join(observations, self._episodes.observe(), self._episodes.t)
