"""The Gymnasium wrappers that `stlbench.wrap` makes: of one environment, and of a vector environment."""

from typing import Any, NoReturn

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Discrete, MultiBinary, MultiDiscrete, Space
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, iterate

from stlbench.contract import Array, RewardMethod, Specification, Truth
from stlbench.errors import UsageError
from stlbench.simulation.gymnasium.episodes import Episodes, Observing
from stlbench.simulation.gymnasium.scoring import Scoring, masked, row_of
from stlbench.task.gym_make import begun, stepped

Info = dict[str, Any]
_ALL = np.array([0])


class _Scored:
    _scoring: Scoring

    @property
    def specification(self) -> Specification:
        return self._scoring.specification

    @property
    def method(self) -> RewardMethod:
        return self._scoring.method


class StlWrapper(_Scored, gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """An environment that is paid and judged by a formula; `stlbench.wrap` makes it.

    Action, rendering and all other attributes are those of the environment, but for `compute_reward`.
    """

    def __init__(self, env: gymnasium.Env[Any, Any], scoring: Scoring, observing: Observing) -> None:
        RecordConstructorArgs.__init__(self, scoring=scoring, observing=observing)
        gymnasium.Wrapper.__init__(self, env)
        _check_actions(env.action_space)
        self._scoring, self._episodes, self._running = scoring, Episodes(scoring, 1), False
        self._observing, self.observation_space = observing, observing.space

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Any, Info]:
        """Start an episode.

        Returns:
            The observation with time and memory; the info with the entries of `step`, `signals` the first sample.
        """
        observation, info = begun(self.env, seed=seed, options=options)
        signals = self._scoring.reader.one(observation, info, 0)
        self._episodes.start(_ALL, signals)
        self._running = True
        return self._joined(observation), info | self._entries(signals, 0.0, over=False)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, Info]:
        """One step of the environment, paid by the method.

        Returns:
            The observation with time and memory, the reward, whether the episode ended early, whether it is complete;
            and the info with `signals` (1, k), `t`, `env_reward`, the environment's own reward, `robustness` and
            `satisfied`. Before the end of the episode these two are -inf and False: nothing is known. All are of
            NumPy, each of one shape and dtype.
        """
        if not self._running:
            raise ResetNeeded("call reset() first: no episode is running")
        observation, own, terminated, truncated, info = stepped(self.env, action)
        t, ended = int(self._episodes.t[0]) + 1, bool(terminated or truncated)
        signals = self._scoring.reader.one(observation, info, t)
        going, taken = np.ones(1, dtype=np.bool_), _action_rows(action, 1)
        reward, (over,), (complete,) = self._episodes.step(going, signals, taken, np.array([ended]))
        self._running = not over
        info = info | self._entries(signals, float(_own([own], 1)[0]), over=bool(over))
        early = ended and not complete
        return self._joined(observation), float(reward[0]), early or bool(terminated), bool(complete), info

    def compute_reward(self, *arguments: Any, **keywords: Any) -> NoReturn:
        """Raises `UsageError`: a replay buffer that pays by goals would take the environment's own reward."""
        rule = "the method pays whole episodes, and a goal that is put in place of another says nothing of its reward"
        remedy = "train without HerReplayBuffer: leave out `replay_buffer_class`"
        raise UsageError(f"compute_reward: {rule}; {remedy}")

    def _joined(self, observation: Any) -> Any:
        return self._observing.join(observation, self._episodes.observe()[0], self._episodes.t)

    def _entries(self, signals: Array, own: float, over: bool) -> Info:
        """The entries of the info.

        A truth is an array (), not a scalar: of scalars Gymnasium's vector environments make arrays of objects.
        """
        entries = self._episodes.entries(signals, np.array([own]), np.array([over]))
        first = {name: values[0] for name, values in entries.items()}
        return first | {"satisfied": np.asarray(first["satisfied"])}


class StlVectorWrapper(_Scored, gymnasium.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """A vector environment whose copies are paid and judged by a formula; `stlbench.wrap` makes it.

    It does what N copies of `StlWrapper` in a `gymnasium.vector.SyncVectorEnv` with the same autoreset mode do.
    """

    def __init__(self, env: gymnasium.vector.VectorEnv[Any, Any, Any], scoring: Scoring, observing: Observing) -> None:
        super().__init__(env)
        _check_actions(env.single_action_space)
        self._scoring, self._episodes, self._mode = scoring, Episodes(scoring, env.num_envs), autoreset_of(env)
        self._observing, self.single_observation_space = observing, observing.space
        self.observation_space = batch_space(observing.space, env.num_envs)
        self._shape = env.num_envs, len(scoring.specification.signals)
        self._over, self._running = np.ones(env.num_envs, dtype=np.bool_), False

    def reset(self, *, seed: Any = None, options: Info | None = None) -> tuple[Any, Info]:
        """Start episodes in all copies, or in those of `options["reset_mask"]`; see `StlWrapper.reset`."""
        mask = np.array((options or {}).get("reset_mask", np.ones(self.num_envs, dtype=np.bool_)))
        observations, infos = begun(self.env, seed=seed, options=options)
        each, signals = list(iterate(self.env.observation_space, observations)), np.zeros(self._shape)
        for copy in np.flatnonzero(mask).tolist():
            signals[copy] = self._scoring.reader.one(each[copy], row_of(infos, copy), 0, copy)
        self._start(mask, signals)
        self._over, self._running = self._over & ~mask, True
        none = np.zeros(self.num_envs, dtype=np.bool_)
        return self._joined(observations), infos | self._entries(signals, np.zeros(self.num_envs), none, mask)

    def step(self, actions: Any) -> tuple[Any, Array, Truth, Truth, Info]:
        """One step of each copy, see `StlWrapper.step`; copies restart when the vector environment has them do so.

        Under `AutoresetMode.SAME_STEP` what belongs to the end of an episode is in `final_obs` and `final_info`. Under
        `NEXT_STEP` a copy that restarts is paid 0.
        """
        if not self._running or (self._mode is AutoresetMode.DISABLED and self._over.any()):
            raise ResetNeeded("call reset() first: in some copy no episode is running")
        observations, own, terminations, truncations, infos = stepped(self.env, actions)
        same_step, taken = self._mode is AutoresetMode.SAME_STEP, _action_rows(actions, self.num_envs)
        restarting = self._over if self._mode is AutoresetMode.NEXT_STEP else np.zeros_like(self._over)
        ended = (terminations | truncations) & ~restarting
        restarted = ended if same_step else restarting
        signals = self._scoring.reader.many(observations, infos, np.where(restarted, 0, self._episodes.t + 1))
        last = self._last(signals, ended, infos) if same_step else signals
        rewards, over, complete = self._episodes.step(~restarting, last, taken, ended)
        if self._mode is not AutoresetMode.DISABLED and (late := complete & ~ended).any():
            rule = f"goes on after step {self._episodes.steps}; steps should be its time limit"
            raise UsageError(f"the vector environment restarts by itself, but copy {late.argmax()} {rule}")
        own = np.where(restarting, 0.0, _own(own, self.num_envs))
        if same_step and over.any():
            infos = self._finals(infos, self._entries(last, own, over, over), over)
            own = np.where(over, 0.0, own)  # these infos now belong to a first sample, which nobody paid for
        judged = over & ~restarted
        self._start(restarted, signals)
        self._over = over
        infos = infos | self._entries(signals, own, judged, np.ones_like(over))
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

    def _finals(self, infos: Info, entries: Info, over: Truth) -> Info:
        """The infos with what belongs to the end of episodes that are over, before their copies restart."""
        shown, final_obs = self._episodes.observe(), np.full(self.num_envs, None, dtype=object)
        for row in np.flatnonzero(over).tolist():
            final_obs[row] = self._observing.join(infos["final_obs"][row], shown[row], self._episodes.t[[row]], row)
        finals = {"final_obs": final_obs, "final_info": infos.get("final_info", {}) | entries}
        return infos | finals | {"_final_obs": over.copy(), "_final_info": over.copy()}

    def _start(self, which: Truth, signals: Array) -> None:
        rows = np.flatnonzero(which)
        if len(rows):
            self._episodes.start(rows, signals[rows])

    def _entries(self, signals: Array, own: Array, over: Truth, which: Truth) -> Info:
        """The entries of `StlWrapper`, of some of the copies (N,); those whose episodes are over are judged."""
        entries = self._episodes.entries(signals, own, over)
        return {key: value for name, values in entries.items() for key, value in masked(name, values, which).items()}

    def _joined(self, observations: Any) -> Any:
        return self._observing.join(observations, self._episodes.observe(), self._episodes.t)


def autoreset_of(envs: gymnasium.vector.VectorEnv[Any, Any, Any]) -> AutoresetMode:
    """When the copies restart. Raises `UsageError` where a vector environment does not say it."""
    mode = envs.metadata.get("autoreset_mode")
    if not isinstance(mode, AutoresetMode):
        raise UsageError("the vector environment does not say when it restarts: metadata['autoreset_mode']")
    return mode


def _check_actions(space: Space[Any]) -> None:
    if not isinstance(space, Box | Discrete | MultiBinary | MultiDiscrete):
        raise UsageError(
            f"actions are numbers, a Box, Discrete, MultiDiscrete or MultiBinary; the environment has {space}"
        )


def _own(rewards: Any, count: int) -> Array:
    """The environment's own reward of its copies (N,); NaN where a reward is not one number, as nothing needs it."""
    try:
        each = np.asarray(rewards, dtype=np.float64).reshape(count, -1)
    except (TypeError, ValueError):
        each = np.empty((count, 0))
    return each[:, 0] if each.shape[1] == 1 else np.full(count, np.nan)


def _action_rows(action: Any, count: int) -> Array:
    """One action, or N batched ones, as numbers (count, axes)."""
    return np.asarray(action, dtype=np.float64).reshape(count, -1)
