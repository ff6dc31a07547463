"""One Q-network in training: its updates against the loss written out in torch."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers import plain_q
from numpy.typing import NDArray

from stlbench.contract import ActionGrid, Event, Integers, Transition, Unsuitable
from stlbench_agents.dqn import DQN, Team
from stlbench_agents.policies import Head
from stlbench_agents.q_learner import QLearner
from stlbench_agents.q_policy import GreedyPolicy

GRID = ActionGrid(("v", "w"), ((-1.0, 0.0, 1.0), (0.0, 1.0)))
INPUTS, ROWS = 4, 32


def learner(updates: int = 100, seed: int = 0, **recipe: Any) -> QLearner:
    """Parameters that are floats must be given as floats: updates are compiled anew for whole numbers."""
    sizes: dict[str, Any] = {"net_arch": (12, 8), "batch_size": ROWS}
    return QLearner(DQN(**(sizes | recipe)), INPUTS, ROWS, GRID, seed, updates)


def some(ours: QLearner, seed: int) -> Integers:
    """Store three random lock-steps, a third of whose transitions stop a return; where the first lies, (1, B)."""
    generator, begin = np.random.default_rng(seed), ours.replay.count
    for _ in range(3):
        kind = np.minimum(generator.integers(9, size=ROWS), 3)
        transition = Transition(
            observation=np.zeros((ROWS, INPUTS)),
            reward=generator.normal(size=ROWS),
            arrived=generator.normal(size=(ROWS, INPUTS)),
            event=(Event.END - kind).astype(np.int8),
        )
        ours.replay.add(generator.normal(size=(ROWS, INPUTS)), generator.integers(GRID.size, size=ROWS), transition)
    return (begin * ROWS + np.arange(ROWS))[None]


def update(ours: QLearner, seed: int) -> None:
    ours.update(some(ours, seed))


def both_gradients(ours: QLearner, seed: int, target: NDArray[Any] | None = None) -> tuple[NDArray[Any], NDArray[Any]]:
    """Of an update, ours and that of the loss written out, at the weights before it; the latter in float64."""
    recipe, first = ours.recipe, some(ours, seed)
    online = ours.weights.online.copy()
    target = ours.weights.target.copy() if target is None else target
    batch = ours.replay.batch(first[0])
    ours.update(first)
    shape = plain_q.Shape(INPUTS, recipe.net_arch, GRID.shape, recipe.head)
    expected = plain_q.gradient(shape, online, target, *batch[:5], recipe.double)
    assert np.linalg.norm(expected) > 0.01
    return ours.weights.gradient.astype(np.float64), expected


def flat(ours: QLearner) -> NDArray[Any]:
    """A copy of the current weights, in float64."""
    return ours.weights.online.astype(np.float64)


@pytest.mark.parametrize("head", ["joint", "additive"])
@pytest.mark.parametrize("double", [True, False])
def test_the_gradient_is_that_of_the_loss(head: Head, double: bool) -> None:
    # tau = 0 leaves the target network at the first weights, so that it differs from the online network
    ours = learner(head=head, double=double, tau=0.0, learning_rate=0.01, gamma=0.9)
    target = flat(ours)
    for i in range(20):
        update(ours, 100 + i)
    assert np.abs(flat(ours) - target).max() > 0.01
    for seed in range(5):
        found, expected = both_gradients(ours, seed, target)
        assert found == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("time_limit", ["bootstrap", "terminal"])
def test_what_follows_a_time_limit_is_the_recipes(time_limit: str) -> None:
    ours = learner(time_limit=time_limit, gamma=0.5, n_steps=1)
    wide = np.zeros((ROWS, INPUTS))
    limit = Transition(wide, np.ones(ROWS), wide, np.full(ROWS, Event.TIME_LIMIT, np.int8))
    ours.replay.add(wide, np.zeros(ROWS, np.int64), limit)
    assert ours.replay.batch(np.arange(1)).discount[0] == (0.5 if time_limit == "bootstrap" else 0)


@pytest.mark.parametrize(("bounded", "bounds"), [(True, [-4, 8]), (False, [-np.inf, np.inf])])
def test_targets_are_bounded_by_the_rewards_where_the_recipe_says_so(bounded: bool, bounds: list[float]) -> None:
    ours = learner(bounded=bounded, reward_scale=4.0)
    for reward in (2.0, -1.0):
        here = np.zeros((ROWS, INPUTS))
        step = Transition(here, np.full(ROWS, reward), here, np.full(ROWS, Event.END, np.int8))
        ours.replay.add(here, np.zeros(ROWS, np.int64), step)
    assert ours.replay.memory.bounds.tolist() == bounds


def test_many_updates_in_one_call_are_as_many_calls() -> None:
    recipe: dict[str, Any] = {"learning_rate": 0.01, "target_update_interval": 2, "tau": 0.5, "averaging": 0.75}
    together, apart = learner(**recipe), learner(**recipe)
    first = np.concatenate([some(together, seed) for seed in range(5)])
    for seed in range(5):
        some(apart, seed)
    together.update(first)
    for row in first:
        apart.update(row[None])
    for ours, theirs in zip(together.weights, apart.weights, strict=True):
        assert np.array_equal(ours, theirs)


@pytest.mark.parametrize(("tau", "interval"), [(1.0, 3), (0.25, 1), (0.25, 2)])
def test_the_target_moves_by_tau_every_so_often(tau: float, interval: int) -> None:
    """By all of the way where tau is 1; each gradient is that of the loss with the target as it then is."""
    ours = learner(tau=tau, target_update_interval=interval, learning_rate=0.01)
    target = flat(ours)
    for count in range(1, 8):
        found, expected = both_gradients(ours, count, target)
        assert found == pytest.approx(expected, abs=1e-6)
        if count % interval == 0:
            target = (1 - tau) * target + tau * flat(ours)
        assert ours.weights.target == pytest.approx(target, rel=0, abs=0 if tau == 1 else 1e-6)
        copied = tau == 1 and count % interval == 0
        assert copied or np.abs(flat(ours) - target).max() > 5e-3


def test_the_gradient_is_clipped_by_its_norm() -> None:
    """Adam's first step is rate * g / (|g| + 1e-8): with the norm clipped to 1e-8 its size shows the clipping."""
    ours = learner(max_grad_norm=1e-8, learning_rate=0.5)
    before = flat(ours)
    gradient, _ = both_gradients(ours, 0)
    clipped = gradient * 1e-8 / np.linalg.norm(gradient)
    # Without clipping every entry would be close to .5 in size.
    assert flat(ours) - before == pytest.approx(-0.5 * clipped / (np.abs(clipped) + 1e-8), abs=1e-3)


@pytest.mark.parametrize("updates", [1, 5])
def test_the_rate_falls_geometrically_from_the_first_update_to_the_last(updates: int) -> None:
    """On one and the same gradient each step of Adam is the rate itself.

    The gradient stays as it is to 1e-3 or so, since the weights hardly move; the largest entry shows it best.
    """
    ours = learner(updates, learning_rate=1e-3, learning_rate_final=1e-5, tau=0.0, averaging=0.0)
    first, history = some(ours, 0), [flat(ours)]
    for _ in range(updates):
        ours.update(first)
        history.append(flat(ours))
    steps = np.abs(np.diff(history, axis=0))[:, int(np.abs(ours.weights.gradient).argmax())]
    expected = np.geomspace(1e-3, 1e-5, 5) if updates == 5 else [1e-3]
    assert steps == pytest.approx(expected, rel=0.02)


def test_what_is_reported_is_averaged_first_evenly_then_exponentially() -> None:
    """With averaging .75: the mean of all weights so far up to the fourth update, then .75 old + .25 new."""
    ours, plain = learner(averaging=0.75, learning_rate=0.01), learner(averaging=0.0, learning_rate=0.01)
    update(plain, 0)
    assert np.array_equal(plain.policy().flat, flat(plain))
    history: list[NDArray[Any]] = []
    expected = np.zeros(0)
    for count in range(6):
        update(ours, count)
        history.append(flat(ours))
        expected = np.mean(history, axis=0) if count < 4 else 0.75 * expected + 0.25 * history[-1]
        assert ours.policy().flat == pytest.approx(expected, rel=0, abs=1e-6)
    assert np.abs(flat(ours) - expected).max() > 0.01


def test_random_actions_are_uniform_and_the_others_those_of_the_current_weights() -> None:
    ours, generator = learner(averaging=0.999), np.random.default_rng(0)
    update(ours, 0)
    observation = generator.normal(size=(30_000, INPUTS))
    best = GreedyPolicy(ours.network, ours.network.views(ours.weights.online)).act(observation)
    assert np.array_equal(ours.act(observation, 0.0, generator), best)
    counts = np.bincount(ours.act(observation, 1.0, generator), minlength=GRID.size)
    assert len(counts) == GRID.size == 6
    assert np.abs(counts - 5000).max() < 5 * np.sqrt(5000)
    # of the tenth that is random a sixth is the best all the same
    share = np.mean(ours.act(observation, 0.1, generator) != best)
    assert share == pytest.approx(0.1 * 5 / 6, abs=0.01)


def test_a_training_that_resumes_has_the_earlier_weights() -> None:
    earlier, resumed = learner(seed=1), learner(seed=2)
    resumed.resume(earlier.policy())
    for part in resumed.weights[:3]:
        np.testing.assert_array_equal(part, earlier.weights.online)
    assert not resumed.weights.mean.any()


def test_a_policy_of_another_network_is_refused() -> None:
    with pytest.raises(Unsuitable, match="has 12 and 8 hidden units, and 4 are needed"):
        learner(net_arch=(4,)).resume(learner().policy())
    with pytest.raises(Unsuitable, match="has head joint, and the recipe additive"):
        learner(head="additive").resume(learner().policy())


def test_a_training_goes_on_where_an_earlier_one_ended() -> None:
    earlier = learner(seed=1)
    earlier.replay.count, earlier._count = 20, 30
    earlier.weights.mean[:] = 0.5
    later = learner(seed=2)
    assert later.go_on({name: array.copy() for name, array in earlier.kept().items()})
    for name in ("online", "target", "average", "mean", "square"):
        np.testing.assert_array_equal(getattr(later.weights, name), getattr(earlier.weights, name))
    assert (later._count, later.replay.count) == (30, 20)
    rates = [each.schedule.rate * each.schedule.decay ** (30 - each.schedule.begun) for each in (later, earlier)]
    assert rates[0] == pytest.approx(max(rates[1], (earlier.recipe.learning_rate * 3e-5) ** 0.5))
    for other in ({"net_arch": (4,)}, {"gamma": 0.5}, {"n_steps": 2}, {"reward_scale": 3.0}):
        assert not learner(**other).go_on(earlier.kept())
    with pytest.raises(ValueError, match="actions should be numbers below"):
        later.go_on(earlier.kept() | {"action": np.array([10**9])})


def test_the_robots_of_a_team_go_on_each_with_its_own() -> None:
    earlier, later = (Team([learner(seed=seed + i) for i in range(2)], (2, 2)) for seed in (1, 5))
    for each in earlier.learners:
        each.replay.count = 20
    assert later.go_on(earlier.kept())
    for own, other in zip(later.learners, earlier.learners, strict=True):
        np.testing.assert_array_equal(own.weights.online, other.weights.online)


def test_a_short_training_goes_on_after_a_long_one() -> None:
    earlier = learner(seed=1)
    earlier.replay.count, earlier._count = 20, 10**7
    later = learner(updates=1, seed=2)
    assert later.go_on(earlier.kept())
    later.update(np.zeros((1, ROWS), np.int64))
    assert np.isfinite(later.weights.online).all()
    assert (later.weights.online != earlier.weights.online).any()
