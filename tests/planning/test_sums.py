"""The planner for rewards, against trying all plans: its values, and what its policy earns on the true system."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pytest
from helpers import lattice
from helpers.lattice import Paid, Stepped
from helpers.stepwise import Stepwise

from stlbench.contract import Array, End, Integers, Model, RewardMethod, Specification, Truth
from stlbench_planning import sums

STARTS = (-2, -1, 0, 1, 2)
STEPS = 6


def solved(model: Model, gamma: float) -> sums.SumPolicy:
    return sums.plan(model, *lattice.whole(model), gamma)


def check(model: Model, gamma: float, beyond: Callable[[Array], Array] | None = None) -> None:
    """From every start, the value is the return of the best plan, and the policy's is that, too."""
    policy = solved(model, gamma)
    starts = np.array(np.meshgrid(*[STARTS] * len(model.system.state))).reshape(len(model.system.state), -1).T * 1.0
    best = [lattice.returns(model, lattice.every_plan(model, start), gamma, beyond).max() for start in starts]
    np.testing.assert_allclose(policy.value(starts), best, rtol=1e-5, atol=1e-5)
    earned = lattice.returns(model, lattice.followed(model, policy, starts), gamma, beyond)
    np.testing.assert_allclose(earned, best, rtol=1e-5, atol=1e-5)


def random_pay(seed: int, axes: int = 1) -> Callable[[Array, Integers], Array]:
    """A reward for each whole number and each time, all different."""
    table = np.random.default_rng(seed).normal(size=(12, *[2 * lattice.REACH + 1] * axes))

    def pay(signals: Array, t: Integers) -> Array:
        at = np.clip(np.round(signals).astype(int) + lattice.REACH, 0, 2 * lattice.REACH)
        found: Array = table[(t, *np.moveaxis(at, -1, 0))]
        return found

    return pay


def random_steps(seed: int) -> Callable[[Array, Array, Array, Integers], Array]:
    """A reward for each transition, by where it begins, the action, where it leads, and the time."""
    first, then = random_pay(seed), random_pay(seed + 1)
    by_action = np.random.default_rng(seed + 2).normal(size=3)
    return lambda s, a, s_, t: first(s, t) * then(s_, t + 1) + by_action[a[:, 0].round().astype(int) + 1]


def spec(steps: int, axes: int = 1) -> Specification:
    names = ("x", "y")[:axes]
    return lattice.specification(f"G[0,{steps}] x <= 1", steps, names)


class Latched(Stepwise):
    """Remembers whether x was 2 and whether it was -2, and pays for coming home once each has been."""

    memory_size = 2

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        return np.concatenate([signals == 2, signals == -2], axis=1).astype(float)

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        after = np.maximum(memory, self.initial_memory(next_signals, t))
        home = next_signals[:, 0] == 0
        return after.sum(axis=1) * home + 0.3 * after[:, 1] - 0.01 * np.abs(action[:, 0]), after


class Counting(Stepwise):
    """Counts the samples at 1 or more in a row, up to 3, and pays at 3. What is counted decides, not where x is."""

    memory_size = 1

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        after = np.where(next_signals >= 1, np.minimum(memory + 1, 3), 0)
        return (after[:, 0] == 3) + 0.1 * (next_signals[:, 0] == -1), after


class Deciding(Stepwise):
    """Is over at 2, which pays 1, and at -1, which pays -0.4; until then, a little for where x is."""

    memory_size, can_end = 1, True

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        x, open_ = next_signals[:, 0], memory[:, 0] == 0
        decided = (x == 2) | (x == -1)
        paid = open_ * (np.where(x == 2, 1.0, 0.0) - 0.4 * (x == -1) + 0.01 * ((3 * x + t) % 5) * ~decided)
        return paid, np.maximum(memory, decided[:, None])

    def over(self, memory: Array) -> Truth:
        found: Truth = memory[:, 0] == 1
        return found


def over(limit: int) -> Callable[[Array], Array]:
    found: Callable[[Array], Array] = lambda signals: signals[..., 0] >= limit  # noqa: E731
    return found


def ending(limit: int, reward: float, first: int = 0, last: int = 99) -> End:
    """The episode is over where x >= limit, from sample `first` to sample `last`."""
    t = np.arange(STEPS + 1)
    return End(over(limit), (first <= t) & (t <= last), reward)


def scaled(method: RewardMethod, scale: float) -> RewardMethod:
    method.scale = scale
    return method


ONE = spec(STEPS)
MODELS: dict[str, tuple[Callable[[], RewardMethod], tuple[End, ...]]] = {
    "samples": (lambda: Paid(ONE, random_pay(0)), ()),
    "transitions": (lambda: Stepped(ONE, random_steps(1)), ()),
    "a scale": (lambda: scaled(Paid(ONE, random_pay(3)), 1e3), ()),
    "a small scale": (lambda: scaled(Paid(ONE, random_pay(3)), 1e-3), ()),
    "a memory that is latched": (lambda: Latched(ONE), ()),
    "a memory that counts": (lambda: Counting(ONE), ()),
    "a memory that is over": (lambda: Deciding(ONE), ()),
    "an end that costs": (lambda: Paid(ONE, random_pay(0)), (ending(2, -1.0),)),
    "an end that pays": (lambda: Paid(ONE, random_pay(1)), (ending(2, 0.7),)),
    "an end at some samples": (lambda: Paid(ONE, random_pay(1)), (ending(1, 1.0, first=2, last=3),)),
    "two ends, of which the first counts": (lambda: Paid(ONE, random_pay(2)), (ending(2, 0.5), ending(1, -0.5))),
    "two ends, exchanged": (lambda: Paid(ONE, random_pay(2)), (ending(1, -0.5), ending(2, 0.5))),
    "an end and a scale": (lambda: scaled(Paid(ONE, random_pay(4)), 5.0), (ending(2, 0.2),)),
    "an end and a memory": (lambda: Latched(ONE), (ending(3, 0.4),)),
    "an end, and a memory that is over": (lambda: Deciding(ONE), (ending(3, 0.7), ending(1, -0.7, first=3))),
}


@pytest.mark.parametrize("gamma", [1.0, 0.9, 0.0])
@pytest.mark.parametrize("hold", [1, 2, 3])
@pytest.mark.parametrize("kind", MODELS)
def test_the_value_is_that_of_the_best_plan_and_the_policy_earns_it(kind: str, hold: int, gamma: float) -> None:
    method, ends = MODELS[kind]
    check(lattice.model(method(), hold, ends=ends), gamma)


@pytest.mark.parametrize(("steps", "hold"), [(1, 1), (6, 6)])
def test_of_one_decision(steps: int, hold: int) -> None:
    check(lattice.model(Paid(spec(steps), random_pay(0)), hold), 0.9)


@pytest.mark.parametrize(("steps", "hold"), [(3, 1), (6, 2)])
def test_on_a_plane(steps: int, hold: int) -> None:
    check(lattice.model(Paid(spec(steps, 2), random_pay(7, 2)), hold), 0.9)


def test_a_reward_of_transitions_that_looks_at_samples_alone_has_the_values_of_one_of_samples() -> None:
    pay = random_pay(5)
    of_samples = solved(lattice.model(Paid(ONE, pay), 2), 0.9)
    of_steps = solved(lattice.model(Stepped(ONE, lambda s, a, s_, t: pay(s_, t + 1)), 2), 0.9)
    np.testing.assert_allclose(of_samples.later, of_steps.later, atol=1e-6)
    np.testing.assert_allclose(of_samples.shift, of_steps.shift, atol=1e-6)


@pytest.mark.parametrize("kind", [Latched, Counting])
def test_each_value_of_the_memory_is_planned_with(kind: type[RewardMethod]) -> None:
    """There are 4; from (0, 0) only some are reached, whatever the plan."""
    assert len(solved(lattice.model(kind(ONE)), 1.0).memories) == 4


@dataclass
class GoingOn:
    """What samples are worth if one time's rewards come for ever, by iterating 150 times over whole numbers."""

    pay: Callable[[Array, Integers], Array]
    times: tuple[int, ...]
    """The samples of the decision that comes again and again."""
    gamma: float

    def __call__(self, samples: Array) -> Array:
        found: Array = self._values[samples[:, 0].astype(int) + lattice.REACH]
        return found

    @cached_property
    def _values(self) -> Array:
        x = np.arange(-lattice.REACH, lattice.REACH + 1)
        value, held = np.zeros(len(x)), len(self.times)
        then = x + held * np.array([[-1], [0], [1]])
        paid = np.stack([self._paid(x, a) for a in (-1, 0, 1)])
        at = np.clip(then + lattice.REACH, 0, len(x) - 1)
        for _ in range(150):
            value = np.where(np.abs(then) <= lattice.REACH, paid + self.gamma * value[at], -1e4).max(axis=0)
        return value

    def _paid(self, x: Array, action: int) -> Array:
        rewards = [self.pay((x + action * (i + 1.0))[:, None], np.array(t)) for i, t in enumerate(self.times)]
        return np.asarray(np.mean(rewards, axis=0))


class TestCuts:
    def test_at_a_cut_the_return_goes_on_as_before_for_ever(self) -> None:
        """In closed form. Before the cut at 3, being at 5 is wanted: from x, what is left costs 4 - x, 3 - x, ..."""

        def pay(signals: Array, t: Integers) -> Array:
            aim = np.where(np.asarray(t) <= 3, 5, -5)
            found: Array = -np.abs(signals[..., 0] - aim)
            return found

        def beyond(samples: Array) -> Array:
            away = 5 - samples[:, 0]
            found: Array = -np.sum([0.8**i * np.maximum(away - i - 1, 0) for i in range(12)], axis=0)
            return found

        check(lattice.model(Paid(spec(6), pay), cuts=(3,)), 0.8, beyond)

    @pytest.mark.parametrize("gamma", [0.9, 0.5, 0.0])
    @pytest.mark.parametrize(("steps", "hold", "cut"), [(6, 1, 2), (6, 1, 5), (6, 2, 2), (6, 2, 4)])
    def test_of_random_rewards(self, steps: int, hold: int, cut: int, gamma: float) -> None:
        pay = random_pay(cut)
        beyond = GoingOn(pay, tuple(range(cut - hold + 1, cut + 1)), gamma)
        check(lattice.model(Paid(spec(steps), pay), hold, cuts=(cut,)), gamma, beyond)

    def test_without_a_discount_it_stops_there(self) -> None:
        check(lattice.model(Paid(spec(6), random_pay(0)), cuts=(3,)), 1.0)

    def test_after_the_cut_the_plan_is_for_what_comes(self) -> None:
        """From step 3 on, it is the plan of the task that begins there."""
        pay = random_pay(6)
        policy = solved(lattice.model(Paid(spec(6), pay), cuts=(3,)), 0.9)
        rest = solved(lattice.model(Paid(spec(3), lambda s, t: pay(s, np.asarray(t) + 3))), 0.9)
        states, memory = np.array(STARTS)[:, None] * 1.0, np.empty((len(STARTS), 0))
        late = policy.episode()(states, np.full(len(STARTS), 3), memory)
        early = rest.episode()(states, np.zeros(len(STARTS), dtype=np.int64), memory)
        np.testing.assert_array_equal(late, early)

    def test_a_cut_at_the_end_changes_nothing(self) -> None:
        check(lattice.model(Paid(spec(5), random_pay(0)), cuts=(5,)), 0.9)


class TestTheGridsEdge:
    def test_what_leaves_the_grid_is_lost(self) -> None:
        """Reward is x, but the last point is 3: it stays there, though to leave would pay."""
        model = lattice.model(Paid(spec(6), lambda s, t: s[..., 0]))
        policy = sums.plan(model, *lattice.whole(model, 3), 1.0)
        trace = lattice.followed(model, policy, np.array([[1.0]])).samples[:, 0, 0]
        assert trace.tolist() == [1, 2, 3, 3, 3, 3, 3]
        assert policy.value(np.array([[1.0]])).item() == pytest.approx(17)

    def test_from_a_start_outside_it_comes_in_at_once(self) -> None:
        """One look ahead from outside still tells what leads in."""
        model = lattice.model(Paid(spec(6), lambda s, t: s[..., 0]))
        policy = sums.plan(model, *lattice.whole(model, 3), 1.0)
        assert lattice.followed(model, policy, np.array([[4.0]])).samples[:, 0, 0].tolist() == [4, 3, 3, 3, 3, 3, 3]

    def test_of_equal_plans_the_smallest_actions_are_taken(self) -> None:
        model = lattice.model(Paid(spec(6), lambda s, t: 0 * s[..., 0]))
        assert not lattice.followed(model, solved(model, 0.9), np.array([[0.0], [1.0]])).vectors.any()
