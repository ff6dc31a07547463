"""Any Gymnasium environment, paid and judged by an STL formula: `stlbench.wrap`, without the harness.

>>> import gymnasium, stlbench
>>> env = stlbench.wrap(
...     gymnasium.make("Pendulum-v1"),
...     "G[100,200] abs(theta) <= 0.2",
...     signals={"theta": "atan2(y, x)"},
...     names=("x", "y", "omega"),
...     ranges={"theta": (-3.2, 3.2)},
...     method="funnel",
... )
>>> observation, info = env.reset(seed=0)
>>> observation.shape, info["t"], env.specification.steps
((4,), 0, 200)

The reward is the method's, as `stlbench.gym` pays it for stlbench's own tasks; what the environment itself pays is
`info["env_reward"]`. The policy is shown the time and the method's memory. At the end of an episode the info has the
robustness of its trace, and whether it satisfies the formula.
"""

from collections.abc import Mapping
from numbers import Real
from typing import Any, TypedDict, Unpack, get_args, overload

import gymnasium
import numpy as np
from gymnasium.spaces import Space
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.wrappers import TimeLimit

from stlbench import stl
from stlbench.errors import UsageError, did_you_mean
from stlbench.records.observation import Observation
from stlbench.registry.choices import choice_of
from stlbench.simulation.gymnasium.episodes import Observing
from stlbench.simulation.gymnasium.scoring import MethodOf, Ranges, Reader, Scoring, SignalsOf, first_that_fits, specify
from stlbench.simulation.gymnasium.wrappers import StlVectorWrapper, StlWrapper, autoreset_of
from stlbench.task.file import EarlyEnd
from stlbench.task.gym_spaces import Entries, Expressions, Names, entries_of

__all__ = ["StlVectorWrapper", "StlWrapper", "wrap"]


class _Options(TypedDict, total=False):
    """The arguments of `wrap` that its overloads share, beside those that are required."""

    signals: SignalsOf | Mapping[str, str] | None
    names: Names | None
    scale: Mapping[str, float] | None
    steps: int | None
    dt: float | None
    scaled: bool
    terminated: EarlyEnd
    discount: float


_Formula = str | stl.Formula


@overload
def wrap(
    env: gymnasium.Env[Any, Any], formula: _Formula, *, method: MethodOf, ranges: Ranges, **options: Unpack[_Options]
) -> StlWrapper: ...
@overload
def wrap(
    env: VectorEnv[Any, Any, Any], formula: _Formula, *, method: MethodOf, ranges: Ranges, **options: Unpack[_Options]
) -> StlVectorWrapper: ...
def wrap(
    env: gymnasium.Env[Any, Any] | VectorEnv[Any, Any, Any],
    formula: str | stl.Formula,
    *,
    method: MethodOf,
    ranges: Ranges,
    signals: SignalsOf | Mapping[str, str] | None = None,
    names: Names | None = None,
    scale: Mapping[str, float] | None = None,
    steps: int | None = None,
    dt: float | None = None,
    scaled: bool = False,
    terminated: EarlyEnd = "hold",
    discount: float = 1.0,
) -> StlWrapper | StlVectorWrapper:
    """Have an environment paid by a reward method, and its episodes judged by a formula.

    Args:
        env: an environment, or a vector environment, under any of Gymnasium's autoreset modes. Actions are numbers: a
            Box, Discrete, MultiDiscrete or MultiBinary. One step of it is one step of the formula.
        formula: STL over the signals; its operators without an interval reach to the end of the episode.
        method: a reward method by name, with or without parameters, "funnel" or "flag[beta=10]"; "auto" for
            the first that fits the formula, of flag (only where F is inside of G), funnel, raw, others; or a class, or
            any other callable from a `stlbench.contract.Specification` to a `RewardMethod`.
        ranges: signal -> (low, high), about what it takes, in its unit. Methods scale their rewards by it.
        signals: signal -> expression over entries of the observation that have `names`, and over entries of the info,
            in the grammar that formulas have: {"theta": "atan2(y, x)"}. Or a function from observation and info of one
            environment to signal -> number, which a vector environment calls for each copy. If left out, each signal
            is the entry of its own name.
        names: of the entries of the observation, in their order; of a Dict observation {key: names of its entries}.
        scale: named entry -> about its largest magnitude, where its space has no ends; the same as in a task file.
        steps: T, transitions in an episode; where left out, the environment's time limit.
        dt: sampling time in seconds; with it the intervals of the formula are seconds, without it they are steps.
        scaled: divide rewards by the method's `scale`, as training in stlbench does.
        terminated: what it means that the environment ends an episode before step T, by either flag:

            - "hold": the last sample stays to the end. The last reward has what the method would pay meanwhile.
            - "violated": the formula counts as violated; the robustness is a lower bound over all traces within the
              ranges. It is less if a signal left its range and the recorded samples make that sure. The last reward
              has the method's `floor` for each step that is left.
            - "interval": nothing is known but the ranges. `robustness` and `satisfied` are two numbers, over all
              continuations: least and greatest robustness; whether all satisfy the formula, and whether some do.
              Nothing more is paid, so a method whose rewards are negative then pays for ending early.
        discount: with which rewards that an early end leaves out are added up; that of the learner makes them worth
            what they would have been worth one by one.

    Returns:
        The wrapped environment. It shows what a task of stlbench on this environment shows: entries with ends in the
        observation space from -1 to 1, others divided by their scale. A vector observation has the time in [-1, 1] and
        the method's inputs at its end; a Dict has them as `stl`; any other becomes a Dict of `observation`, as it is,
        and `stl`. An early end is reported as terminated, the end at T as truncated.

    Raises:
        UsageError: in one line, what does not fit: names, scale, signals, ranges, formula, its horizon, method, steps.
            Later, with the step, signals, observations or rewards of the method that are no finite numbers, and signals
            of other names; what `reset` or `step` returns, where it is not Gymnasium's.

    Warns, once, of an observation outside its space.
    """
    _check(ranges, terminated, discount)
    if isinstance(env, VectorEnv):
        single, batched = env.single_observation_space, env.observation_space
        length = steps_of_copies(env, steps, autoreset_of(env))
    elif isinstance(env, gymnasium.Env):
        single = batched = env.observation_space
        length = steps_of(env, steps)
    else:
        raise UsageError(f"wrap takes an environment of Gymnasium, as gymnasium.make gives it, got {env!r}")
    entries = entries_of(single, names)
    reader = _reader(signals, ranges, entries, batched)
    specification = specify(formula, reader.names, ranges, length, dt)
    method = first_that_fits(specification) if method == "auto" else method
    scoring = Scoring(reader, method, specification, scaled, terminated, discount)
    called = str(choice_of(method)) if isinstance(method, str) else ""
    shown = Observation.beside(length, scoring.inputs, called, env.spec.id if env.spec else "")
    observing = Observing(single, entries, {} if scale is None else scale, shown)
    if isinstance(env, VectorEnv):
        return StlVectorWrapper(env, scoring, observing)
    return StlWrapper(env, scoring, observing)


def _check(ranges: Ranges, terminated: str, discount: float) -> None:
    if not isinstance(ranges, Mapping):
        raise UsageError(f"ranges: expected a mapping, signal -> (low, high), got {ranges!r}")
    if terminated not in get_args(EarlyEnd):
        raise UsageError(f"terminated: no '{terminated}'{did_you_mean(str(terminated), get_args(EarlyEnd))}")
    if not isinstance(discount, Real) or not 0 <= discount <= 1:
        raise UsageError(f"discount is a number in 0..1, got {discount!r}")


def _reader(
    signals: SignalsOf | Mapping[str, str] | None, ranges: Ranges, entries: Entries, space: Space[Any]
) -> Reader:
    if callable(signals):
        return Reader(signals, tuple(ranges), space)
    if signals is not None and not isinstance(signals, Mapping):
        raise UsageError(f"signals: expected a mapping, signal -> expression, or a function, got {signals!r}")
    expressions = Expressions({name: name for name in ranges} if signals is None else signals, entries)
    return Reader(expressions, expressions.names, space)


def steps_of(env: gymnasium.Env[Any, Any], steps: int | None) -> int:
    """The given number, else the time limit. Raises `UsageError`: neither, or more than the limit."""
    limit = _wrapped_limit(env)
    if steps is None:
        return _known(limit or _registered(env))  # a user may have wrapped it with a shorter one than the registered
    return _within(steps, limit)


def steps_of_copies(envs: VectorEnv[Any, Any, Any], steps: int | None, mode: AutoresetMode) -> int:
    """The same for a vector environment, which restarts at its own time limit and at no other step."""
    inside = envs.unwrapped  # other vector environments have their copies in other processes, or none at all
    limit = (_wrapped_limit(inside.envs[0]) if isinstance(inside, SyncVectorEnv) else None) or _registered(envs)
    if steps is None:
        return _known(limit)
    if limit is not None and mode is not AutoresetMode.DISABLED and steps != limit:
        raise UsageError(f"steps = {steps}, but the vector environment restarts after {limit}; make it with that limit")
    return _within(steps, limit)


def _known(limit: int | None) -> int:
    if limit is None:
        raise UsageError("steps: the environment says no time limit; give the length of an episode, steps=200")
    return limit


def _within(steps: int, limit: int | None) -> int:
    if isinstance(steps, bool) or not isinstance(steps, int | np.integer) or steps < 1:
        raise UsageError(f"steps is a whole number, at least 1, got {steps!r}")
    if limit is not None and steps > limit:
        raise UsageError(f"steps = {steps}, but the environment ends an episode after {limit}")
    return int(steps)


def _wrapped_limit(env: gymnasium.Env[Any, Any]) -> int | None:
    limits = []
    while isinstance(env, gymnasium.Wrapper):
        if isinstance(env, TimeLimit):
            limits.append(int(env._max_episode_steps))
        env = env.env
    return min(limits, default=None)


def _registered(env: Any) -> int | None:
    """The limit that the environment is registered with, or that `gymnasium.make_vec` was given in its place."""
    if env.spec is None:
        return None
    limit: int | None = env.spec.kwargs.get("max_episode_steps", env.spec.max_episode_steps)
    return limit
