"""What `stlbench.wrap` refuses: options, lengths of episodes, and what environments and methods must not give."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Dict
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit
from helpers.walk_env import BASE, RIGHT, STAY, Walk, played, wrapped

import stlbench
from stlbench import stl
from stlbench.contract import RewardMethod
from stlbench.errors import UsageError
from stlbench.simulation.gymnasium.wrap import steps_of, steps_of_copies


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"formula": "G[0,4] y <= 1"}, "formula: no signal 'y'; there are: x"),
        ({"formula": "G[0,4] x <"}, "formula: line 1, column 11: expected"),
        ({"formula": "G[0,5] x <= 1"}, "formula: its horizon of 5 steps exceeds the 4 steps of an episode"),
        ({"formula": "G[0,.3] x <= 1", "dt": 0.2}, "formula: line 1, column 5: expected a whole number of steps"),
        ({"formula": "G[0,4] x <= 1", "dt": -3}, "formula: dt is the sampling time in seconds and must be positive"),
        (
            {"formula": stl.parse("G[0,4] x <= 1"), "dt": -3},
            "formula: dt is the sampling time in seconds and must be p",
        ),
        ({"formula": stl.parse("G[0,4] x <= 1"), "dt": float("nan")}, "formula: dt is the sampling time .*, got nan"),
        ({"formula": stl.parse("G[0,4] x <= 1"), "dt": "fast"}, "formula: must be real number, not str"),
        ({"signals": {"y": "x"}, "formula": "G[0,4] y <= 1"}, "ranges: none for the signal 'y'"),
        ({"signals": {"y": "x"}, "ranges": {"x": (0, 1), "y": (0, 1)}}, "ranges: no signal 'x'; there are: y"),
        ({"ranges": {"x": (1, 1)}}, r"ranges: 'x' has \(low, high\), finite and low < high, got \(1, 1\)"),
        (
            {"signals": {"pi": "x"}, "ranges": {"pi": (0, 1)}, "formula": "G[0,4] pi <= 1"},
            "formula: pi in a formula is a constant; the environment has a signal 'pi': rename the signal",
        ),
        ({"signals": {"y": "2 * pi"}, "names": ("pi", "x"), "ranges": {"y": (0, 1)}}, "signals: pi in a formula is a"),
        ({"signals": "atan2(y, x)"}, "signals: expected a mapping, signal -> expression, or a function, got 'atan2"),
        ({"method": "funel"}, "no method 'funel'; did you mean 'funnel'"),
        ({"method": "funnel", "formula": "x > 0 U[0,4] x >= 1"}, "method funnel does not fit: until at column 7"),
        ({"steps": None}, "steps: the environment says no time limit; give the length of an episode"),
        ({"steps": 0}, "steps is a whole number, at least 1, got 0"),
        ({"terminated": "violate"}, "terminated: no 'violate'; did you mean 'violated'"),
        ({"discount": 1.5}, "discount is a number in 0..1, got 1.5"),
        ({"ranges": None}, r"ranges: expected a mapping, signal -> \(low, high\), got None"),
        ({"method": dict}, "method: expected a name or a class of reward methods, got <class 'dict'>"),
        ({"scale": {"y": 2}}, "scale: no entry 'y' among the names; there are: minus, x"),
        ({"scale": {"x": 0}}, "scale: 'x' has a magnitude above 0, got 0"),
        ({"scale": 2.0}, "scale: expected a mapping, named entry -> magnitude, got 2.0"),
        ({"scale": 0}, "scale: expected a mapping, named entry -> magnitude, got 0"),
    ],
)
def test_what_does_not_fit_is_one_clear_line(options: dict[str, Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        wrapped(**options)


def test_actions_that_are_no_numbers_and_no_environment() -> None:
    env = Walk()
    env.action_space = Dict({"push": env.action_space})
    with pytest.raises(UsageError, match=r"actions are numbers, a Box, .* or MultiBinary; the environment has Dict"):
        wrapped(env)
    with pytest.raises(UsageError, match=r"wrap takes an environment of Gymnasium, .* got 'Pendulum-v1'"):
        stlbench.wrap("Pendulum-v1", "G x <= 1", **BASE)  # type: ignore[call-overload]
    with pytest.raises(ResetNeeded):
        wrapped().step(STAY)


class Odd(Walk):
    """Its step returns something else."""

    def __init__(self, change: Callable[..., Any]) -> None:
        super().__init__()
        self.change = change

    def step(self, action: Any) -> Any:
        return self.change(*super().step(action))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda *five: five[:4], r"^the environment's step returns .*, terminated, truncated, info, got \(array"),
        (lambda *five: None, "^the environment's step returns observation, .*, got None$"),
        (lambda *five: (*five[:4], True), "^the environment's step returns observation, .*, True"),
    ],
)
def test_a_step_that_is_none_of_gymnasium_s(change: Callable[..., Any], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        played(wrapped(Odd(change)), STAY)


class Lost(Walk):
    """Loses the second number of its observation in its second step."""

    def step(self, action: Any) -> Any:
        observation, *rest = super().step(action)
        part = observation["place"] if self.kind == "dict" else observation
        part[1] = np.nan if self.x == 1 else part[1]
        return observation, *rest


class Nanny(RewardMethod):
    """Pays what is no number where x is 1."""

    def arrival(self, signals: Any, t: Any) -> Any:
        return np.where(signals[..., 0] == 1, np.nan, 1.0)


class Blind(RewardMethod):
    """Shows what is no number."""

    memory_size = input_size = 1

    def along(self, samples: Any, action: Any, t: Any, memory: Any) -> Any:
        return np.zeros((len(samples) - 1, len(t))), memory + 3

    def inputs(self, memory: Any) -> Any:
        return np.where(memory > 4, np.inf, memory)


SEEN = "^the environment returned an observation with nan at step 2{}; numbers are finite$"


@pytest.mark.parametrize("options", [{}, {"names": {"place": ("x", "minus")}, "kind": "dict"}])
def test_an_observation_that_is_no_number_does_not_reach_the_learner(options: dict[str, Any]) -> None:
    kind, signals = options.pop("kind", "vector"), {"signals": {"x": "doubled / 2"}}
    env = wrapped(Lost(kind=kind), **(signals | options))
    env.reset(seed=0)
    env.step(RIGHT)
    with pytest.raises(UsageError, match=SEEN.format("")):
        env.step(RIGHT)
    copies = gymnasium.vector.SyncVectorEnv([lambda: Lost(kind=kind)] * 2)
    envs = stlbench.wrap(copies, "G x <= 9", **(BASE | signals | options), steps=4)
    envs.reset(seed=0)
    envs.step(np.array([STAY, RIGHT]))
    with pytest.raises(UsageError, match=SEEN.format(" of copy 1")):
        envs.step(np.array([STAY, RIGHT]))


@pytest.mark.parametrize(("method", "what"), [(Nanny, "reward is nan"), (Blind, "input is inf")])
def test_what_a_method_must_not_give_is_told_as_in_a_run(method: Any, what: str) -> None:
    env, said = wrapped(method=method), f"^method {method.__name__}: {what} at step 2 in 1 of 1 copies$"
    env.reset(seed=0)
    env.step(RIGHT)
    with pytest.raises(UsageError, match=said):
        env.step(RIGHT)


class Grown(Walk):
    """Has observations of another length from its first step on."""

    def step(self, action: Any) -> Any:
        observation, *rest = super().step(action)
        return np.append(observation, 0).astype(np.float32), *rest


@pytest.mark.parametrize("options", [{}, {"names": None, "signals": lambda observation, info: {"x": observation[0]}}])
def test_an_environment_that_changes_its_observations(options: dict[str, Any]) -> None:
    env = wrapped(Grown(), **options)
    env.reset(seed=0)
    with pytest.raises(UsageError, match=r"^the environment returned an observation outside its space: .*3.* of .*2"):
        env.step(RIGHT)


# ----------------------------------------------------------------------------------------------- lengths of episodes


@pytest.mark.parametrize(
    ("make", "steps", "expected"),
    [
        (lambda: gymnasium.make("CartPole-v1"), None, 500),
        (lambda: gymnasium.make("CartPole-v1", max_episode_steps=30), None, 30),
        (lambda: gymnasium.make("CartPole-v1"), 20, 20),
        (lambda: TimeLimit(TimeLimit(Walk(), 9), 5), None, 5),
        (Walk, 70, 70),
        (lambda: TimeLimit(Walk(), 5), 6, "steps = 6, but the environment ends an episode after 5"),
        (Walk, None, "the environment says no time limit"),
        (Walk, True, "steps is a whole number, at least 1, got True"),
        (Walk, 2.0, "steps is a whole number, at least 1, got 2.0"),
    ],
)
def test_of_one_environment(make: Any, steps: Any, expected: Any) -> None:
    if isinstance(expected, int):
        assert steps_of(make(), steps) == expected
        return
    with pytest.raises(UsageError, match=expected):
        steps_of(make(), steps)


def test_of_copies_that_do_not_restart_it_may_be_shorter() -> None:
    envs = SyncVectorEnv([lambda: TimeLimit(Walk(), 9)])
    assert steps_of_copies(envs, 5, AutoresetMode.DISABLED) == 5
    with pytest.raises(UsageError, match="restarts after 9; make it with that limit"):
        steps_of_copies(envs, 5, AutoresetMode.NEXT_STEP)
    with pytest.raises(UsageError, match="ends an episode after 9"):
        steps_of_copies(envs, 10, AutoresetMode.DISABLED)


def test_of_copies_made_with_another_limit() -> None:
    for mode in ("sync", "vector_entry_point"):
        envs = gymnasium.make_vec("CartPole-v1", 2, vectorization_mode=mode, max_episode_steps=30)
        assert steps_of_copies(envs, None, AutoresetMode.NEXT_STEP) == 30
