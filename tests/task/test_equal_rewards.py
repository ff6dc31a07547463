"""Whether two methods pay for the same, of methods that were written for it and of those that come with stlbench."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.episodes import specification
from helpers.stepwise import Stepwise

from stlbench.contract import Array, Integers, RewardMethod
from stlbench.task import fitting_methods, load_task
from stlbench.task.build import Difference, equal_payments, payments

SPECIFICATION = specification("G[0,5] x >= 1", {"x": (-2.0, 2.0)}, steps=6)


class Paid(RewardMethod):
    """weight * x + rate * t + constant, in a part of the box alone where `above` says so."""

    def __init__(self, weight: float = 1, rate: float = 0, constant: float = 0, above: float = -9) -> None:
        super().__init__(SPECIFICATION)
        self.weight, self.rate, self.constant, self.above = weight, rate, constant, above

    def arrival(self, signals: Array, t: Integers) -> Array:
        paid: Array = np.where(signals[..., 0] > self.above, self.weight * signals[..., 0], 0)
        return paid + self.rate * t + self.constant


class Stepped(Stepwise):
    """x, by transitions."""

    def step(self, signals: Array, action: Any, next_signals: Array, t: Any, memory: Array) -> tuple[Array, Array]:
        return next_signals[:, 0], memory


def equal(methods: dict[str, RewardMethod]) -> tuple[Difference, ...]:
    return equal_payments({name: payments(method) for name, method in methods.items()})


def difference(one: RewardMethod, other: RewardMethod) -> Difference | None:
    return next(iter(equal({"one": one, "other": other})), None)


@pytest.mark.parametrize(
    ("other", "constant"),
    [(Paid(), 0), (Paid(constant=-0.5), 0.5), (Paid(rate=2), None), (Paid(rate=-1e-3, constant=4), None)],
)
def test_a_function_of_time_makes_no_difference(other: Paid, constant: float | None) -> None:
    assert difference(Paid(), other) == Difference("one", "other", constant)


@pytest.mark.parametrize("other", [Paid(weight=1 + 1e-6), Paid(above=-1.9), Paid(above=1.9, rate=1)])
def test_what_depends_on_the_sample_does(other: Paid) -> None:
    assert difference(Paid(), other) is None
    assert difference(other, Paid()) is None


def test_rounding_makes_none() -> None:
    assert difference(Paid(), Paid(weight=1 + 1e-12)) == Difference("one", "other", 0)


def test_the_last_sample_counts_and_the_first_does_not() -> None:
    """Paid are the samples at 1..T."""
    times = list[int]()

    class Seen(Paid):
        def arrival(self, signals: Array, t: Integers) -> Array:
            times.extend(np.unique(t).tolist())
            return super().arrival(signals, t)

    difference(Seen(), Paid())
    assert times == [1, 2, 3, 4, 5, 6]


def test_infinite_rewards_and_those_that_are_not_paid_for_samples_say_nothing() -> None:
    assert difference(Paid(constant=np.inf), Paid(constant=np.inf)) is None
    assert difference(Paid(), Stepped(SPECIFICATION)) is None


def test_words() -> None:
    pairs = {0.0: "a is b", 0.25: "a is b plus 0.25 at all times", -0.99: "a is b minus 0.99 at all times"}
    assert {constant: str(Difference("a", "b", constant)) for constant in pairs} == pairs
    assert str(Difference("a", "b", None)) == "a is b plus a function of time alone"


@pytest.mark.parametrize(
    ("task", "found"),
    [
        ("hold-disc", ["funnel is raw minus 0.99 at all times"]),
        ("hold-disc-coarse", ["funnel is raw minus 0.99 at all times"]),
        ("integrator-or", ["funnel is raw minus 4.99 at all times"]),
        ("robot-nav", ["funnel is raw plus a function of time alone"]),
        ("overlap", []),
    ],
)
def test_funnel_and_raw(task: str, found: list[str]) -> None:
    """By hand: of one term from t* on, the funnel is rho - rho_max + gamma_inf; hold-disc: -1 + .01. Overlapping terms
    have funnels of their own, which move the place where one becomes the least."""
    methods = fitting_methods(load_task(task), ["flag", "funnel", "raw"])
    assert [str(each) for each in equal(methods)] == found


def test_each_pair_once_and_no_method_that_does_not_fit() -> None:
    task = load_task("hold-disc")
    methods = fitting_methods(task, ["raw", "funnel[ginf=0.5]", "funnel", "no-such", "funnel[ginf=no]"])
    assert list(methods) == ["raw", "funnel[ginf=0.5]", "funnel"]
    pairs = [(found.one, found.other) for found in equal(methods)]
    assert pairs == [("raw", "funnel[ginf=0.5]"), ("raw", "funnel"), ("funnel[ginf=0.5]", "funnel")]
