"""Every installed method keeps the contract, and the checks notice what does not."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.latch import Latch
from helpers.line_task import Probe

from stlbench.contract import Intractable, RewardMethod, Unsuitable
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.testing import check_agent, check_executor, check_method, check_task

METHODS, TASKS = plugins.available("methods"), plugins.available("tasks")
VARIANTS = (
    *["funnel[shape=clipped]", "funnel[shape=normalised,variant=code]", "funnel[activity=literal,t_star=0]"],
    *["raw[activity=literal]", "flag[beta=2]", "tau-mdp[form=probability]", "tau-mdp[beta=5]", "hprs[later=target]"],
    *["hprs[variant=auto-shaping,gamma=0.9]", "hprs[violation=ends,later=target]", "machine[shaping=phases]"],
    *["counters[pays=verdict]", "cfer[flags=published]", "tau-cmdp[window=after]"],
)


ALL = [*METHODS, *VARIANTS]
NIGHTLY = pytest.mark.slow
PAIRS = [
    pytest.param(method, task, marks=() if (i + j) % 9 == 0 else NIGHTLY)
    for i, method in enumerate(ALL)
    for j, task in enumerate(TASKS)
]
"""A ninth of all pairs, in which each method and each task is, for each change; all of them every night."""


@pytest.mark.parametrize(("method", "task"), PAIRS)
def test_every_installed_method_on_every_installed_task(method: str, task: str) -> None:
    try:
        check_method(method, task)
    except (Unsuitable, Intractable) as refusal:
        assert str(refusal)  # noqa: PT017  # a refusal is an answer, with its reason


SEMANTICS = [
    "tltl[semantics=gmsr]",
    "tltl[semantics=gilpin]",
    "bhnr[semantics=gilpin]",
    "bhnr[mode=block,semantics=lse]",
]
SEMANTICS += ["bhnr[semantics=filtering-sum]", "dense[semantics=gilpin]", "dense[mode=difference]"]


@pytest.mark.parametrize("method", [*ALL, *SEMANTICS, "sparse[pays=failure]"])
def test_every_installed_method_on_small_formulas(method: str) -> None:
    check_method(method)


class Sound(Probe):
    """Within all rules, with a memory: the base of what is broken below."""

    scale = 2000.0
    floor = -2000.0

    def __init__(self, specification: Any, *, memory_size: int = 2) -> None:
        super().__init__(specification, memory_size)

    def inputs(self, memory: np.ndarray) -> np.ndarray:
        return np.tanh(memory)


def broken(**methods: Any) -> type[RewardMethod]:
    return type("Broken", (Sound,), methods)


def changed(function: Callable[..., Any]) -> type[RewardMethod]:
    """`Sound` with another step: a function of self, of the result of `Sound.step`, and of its arguments."""

    def step(self: Any, *given: Any) -> Any:
        return function(self, *Sound.step(self, *given), *given)

    return broken(step=step)


def impure_step(self: Any, reward: Any, memory: Any, *given: Any) -> Any:
    self.calls = getattr(self, "calls", 0) + 1
    return reward + self.calls, memory


def in_place(self: Any, reward: Any, memory: Any, *given: Any) -> Any:
    given[4][:] += 1
    return reward, given[4]


def unannotated(self: Any, specification: Any, *, weight=1.0) -> None:  # type: ignore[no-untyped-def]
    Sound.__init__(self, specification)


def positional(self: Any, specification: Any, weight: float = 1.0) -> None:
    Sound.__init__(self, specification)


BATCH = r"rewards \(1, 6\)"
SHAPES = rf"along gives {BATCH} and memory \(6, 2\)"


@pytest.mark.parametrize(
    ("method", "rule"),
    [
        (broken(scale=0.0), "scale is positive and finite; got 0.0"),
        (broken(scale=100.0), "rewards are at most about scale = 100 in size"),
        (broken(preference={"grid": 1}), "preference has places from 1 on for some of recurring, other, sum; got"),
        (broken(floor=0.5), r"Broken: no reward in the box of the signals is below its floor = 0\.5; got -"),
        (broken(describe=lambda self: {"when": np.arange(3)}), "describe gives what JSON can hold"),
        (broken(initial_memory=lambda self, s, t: np.zeros((len(s), 3))), r"initial_memory has shape \(6, 2\); got"),
        (broken(initial_memory=lambda self, s, t: np.full((len(s), 2), np.nan)), "initial_memory is finite"),
        (broken(inputs=lambda self, m: m[:, :1]), r"inputs has shape \(6, 2\); got \(6, 1\)"),
        (broken(inputs=lambda self, m: m), r"inputs are about in \[-1, 1\]"),
        (changed(lambda self, r, m, *_: (r[:, None], m)), f"{SHAPES}, for a step of 6 copies; got {BATCH[:-2]}, 1"),
        (changed(lambda self, r, m, *_: (r, np.hstack([m, m[:, :1]]))), rf"{SHAPES}, .*; got {BATCH} .* \(6, 3\)"),
        (changed(lambda self, r, m, *_: (r + 0j, m)), "rewards are an array of real numbers; got complex128"),
        (broken(__init__=unannotated), r"parameters of the constructor are keyword-only, .*; got weight$"),
        (broken(__init__=positional), r"parameters .* as in \(\*, weight: float = 1\.0\); got weight$"),
        (broken(__init__=lambda self, specification: None), r"the constructor calls super\(\).__init__\(.* not call"),
        (changed(lambda self, r, m, *given: (r / 0, m)), "along is finite"),
        (changed(impure_step), "along is pure"),
        (changed(in_place), "along leaves its arguments alone"),
        (changed(lambda self, r, m, *given: (r - r.mean(), m)), "along of a batch is that of its rows"),
        (changed(lambda self, r, m, *given: (r * 0 + given[3][0] ** 2, m)), "rows may be at different times"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero:RuntimeWarning")
def test_a_method_that_breaks_a_rule_is_told_which(method: type[RewardMethod], rule: str) -> None:
    check_method(Sound)
    with pytest.raises(AssertionError, match=f"^rule broken: {rule}"):
        check_method(method)


def latched(**methods: Any) -> type[RewardMethod]:
    return type("Broken", (Latch,), methods)


def unlatching(self: Any, signals: Any, action: Any, next_signals: Any, t: Any, memory: Any) -> Any:
    return Latch.step(self, signals, action, next_signals, t, memory)[0], (next_signals[:, :1] >= 1).astype(float)


def going_on(self: Any, signals: Any, action: Any, next_signals: Any, t: Any, memory: Any) -> Any:
    paid, after = Latch.step(self, signals, action, next_signals, t, memory)
    return paid + 0.1, after


@pytest.mark.parametrize(
    ("method", "rule"),
    [
        (latched(over=lambda self, m: m[:, 0]), "over gives bool; got float64"),
        (latched(over=lambda self, m: m == 1), r"over has shape \(6,\); got \(6, 1\)"),
        (latched(step=going_on), "nothing is paid after it is over"),
        (latched(step=unlatching), "what is over remains so"),
        (latched(counterfactual=lambda self, s, t, m, c: c[0]), r"counterfactual has shape \(6, 1\); got \(1,\)"),
        (latched(counterfactual=lambda self, s, t, m, c: c - c.mean()), "counterfactual of a batch is that of its"),
        (latched(counterfactual=lambda self, s, t, m, c: m + 9), "inputs of a counterfactual memory are about in"),
    ],
)
def test_what_a_method_adds_is_checked_too(method: type[RewardMethod], rule: str) -> None:
    check_method(Latch)
    with pytest.raises(AssertionError, match=f"^rule broken: {rule}"):
        check_method(method)


def test_a_method_that_refuses_every_formula_says_why() -> None:
    class Picky(Sound):
        def __init__(self, specification: Any) -> None:
            raise Unsuitable("only formulas about the weather")

    with pytest.raises(Unsuitable, match="about the weather"):
        check_method(Picky)


@pytest.mark.parametrize(
    ("check", "given", "message"),
    [
        (check_method, ["funel[ginf=1]"], "no method 'funel'; did you mean 'funnel'?"),
        (check_method, ["funnel[ginff=1]"], "funnel[ginff=1]: no parameter 'ginff'; did you mean 'ginf'?"),
        (check_method, ["funnel", "hold-disk"], "no task 'hold-disk'; did you mean 'hold-disc'?"),
        (check_task, ["hold-disk"], "no task 'hold-disk'; did you mean 'hold-disc'?"),
        (check_agent, ["dqm"], "no agent 'dqm'; did you mean 'dqn'?"),
        (check_executor, ["locl"], "no executor 'locl'; did you mean 'local'?"),
    ],
)
def test_a_mistyped_choice_fails_and_says_what_there_is(
    check: Callable[..., None], given: list[str], message: str
) -> None:
    with pytest.raises(UsageError) as caught:
        check(*given)
    assert str(caught.value) == message
