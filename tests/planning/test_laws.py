"""What planning must not see in a reward: a function of time, a potential, a factor."""

from __future__ import annotations

import numpy as np
import pytest
from helpers import lattice
from helpers.lattice import Paid, Stepped

from stlbench.contract import Array, Integers, Model, RewardMethod
from stlbench_planning import sums

STEPS = 6
SPEC = lattice.specification("G[0,6] x <= 1", STEPS)
TABLE = np.random.default_rng(11).normal(size=(STEPS + 1, 2 * lattice.REACH + 1))
BY_TIME = np.random.default_rng(12).normal(size=STEPS + 1)
POTENTIAL = np.random.default_rng(13).normal(size=(STEPS + 1, 2 * lattice.REACH + 1))
POTENTIAL[STEPS] = 0  # an episode ends without any
STATES = np.arange(-2.0, 3.0)[:, None]
CASES = pytest.mark.parametrize(("gamma", "hold"), [(1.0, 1), (0.9, 1), (0.9, 2), (0.0, 3)])


def at(table: Array, signals: Array, t: Integers) -> Array:
    """A table's entry for whole numbers."""
    index = np.clip(np.round(signals[..., 0]).astype(int) + lattice.REACH, 0, 2 * lattice.REACH)
    found: Array = table[t, index]
    return found


def plain() -> RewardMethod:
    return Paid(SPEC, lambda s, t: at(TABLE, s, t))


def planned(method: RewardMethod, gamma: float, hold: int) -> tuple[Model, sums.SumPolicy]:
    model = lattice.model(method, hold)
    return model, sums.plan(model, *lattice.whole(model), gamma)


def chosen(model: Model, policy: sums.SumPolicy) -> Array:
    """The actions at every decision, from every state within 3 of 0."""
    states = np.arange(-3.0, 4.0)[:, None]
    act, none = policy.episode(), np.empty((7, 0))
    return np.stack([act(states, np.full(7, t), none) for t in range(0, STEPS, model.hold)])


@CASES
@pytest.mark.parametrize("kind", ["samples", "transitions"])
def test_a_function_of_time_changes_no_action_and_adds_its_own_sum(kind: str, gamma: float, hold: int) -> None:
    if kind == "samples":
        more: RewardMethod = Paid(SPEC, lambda s, t: at(TABLE, s, t) + BY_TIME[t])
    else:
        more = Stepped(SPEC, lambda s, a, s_, t: at(TABLE, s_, t + 1) + BY_TIME[t + 1])
    model, with_time = planned(more, gamma, hold)
    _, without = planned(plain(), gamma, hold)
    np.testing.assert_array_equal(chosen(model, with_time), chosen(model, without))
    means = BY_TIME[1:].reshape(-1, hold).mean(axis=1)
    added = (gamma ** np.arange(len(means)) * means).sum()
    np.testing.assert_allclose(with_time.value(STATES), without.value(STATES) + added, atol=1e-5)


@CASES
def test_a_potential_changes_no_action_and_adds_what_it_is_at_the_start(gamma: float, hold: int) -> None:
    """r + gamma Phi(s') - Phi(s), where gamma counts once a decision, and rewards are averaged over its steps."""

    def pay(signals: Array, action: Array, next_signals: Array, t: Integers) -> Array:
        discount = np.where((t + 1) % hold == 0, gamma, 1.0)
        shaping = discount * at(POTENTIAL, next_signals, t + 1) - at(POTENTIAL, signals, t)
        return at(TABLE, next_signals, t + 1) + hold * shaping

    model, shaped = planned(Stepped(SPEC, pay), gamma, hold)
    _, without = planned(plain(), gamma, hold)
    np.testing.assert_array_equal(chosen(model, shaped), chosen(model, without))
    start = at(POTENTIAL, STATES, np.zeros(len(STATES), dtype=np.int64))
    np.testing.assert_allclose(shaped.value(STATES), without.value(STATES) - start, atol=1e-5)


@CASES
@pytest.mark.parametrize(("factor", "scale"), [(0.01, 1.0), (40.0, 1.0), (40.0, 40.0)])
def test_a_factor_changes_no_action_and_multiplies_the_value(
    factor: float, scale: float, gamma: float, hold: int
) -> None:
    """Whether the method says so, by its scale, or not."""
    method = Paid(SPEC, lambda s, t: factor * at(TABLE, s, t))
    method.scale = scale
    model, larger = planned(method, gamma, hold)
    _, plainly = planned(plain(), gamma, hold)
    np.testing.assert_array_equal(chosen(model, larger), chosen(model, plainly))
    np.testing.assert_allclose(larger.value(STATES), factor * plainly.value(STATES), rtol=1e-4, atol=1e-5 * factor)


def test_a_reward_that_is_no_function_of_time_apart_does_change_the_plan() -> None:
    """Else the tests above could not fail."""
    model, policy = planned(plain(), 0.9, 1)
    _, other = planned(Paid(SPEC, lambda s, t: at(TABLE, s, t) + 0.5 * s[..., 0]), 0.9, 1)
    assert (chosen(model, policy) != chosen(model, other)).any()
