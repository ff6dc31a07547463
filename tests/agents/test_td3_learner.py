"""TD3 in training: targets and updates by hand, and as with torch's Adam; its policy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from helpers.plain_perceptron import perceptron
from numpy.typing import NDArray

from stlbench.contract import ActionBox, Integers, Transition, Unsuitable
from stlbench_agents.layers import views
from stlbench_agents.replay import Batch
from stlbench_agents.td3 import TD3
from stlbench_agents.td3_learner import Noise, TD3Buffers, TD3Learner, actor_gradient, critic_gradient, targets

Floats = NDArray[Any]
BOX = ActionBox(("v", "w"), (-1.0, 0.0), (1.0, 4.0))
INPUTS = 3


def learner(**parameters: Any) -> TD3Learner:
    made = new(batch_size=6, **parameters)
    made.replay.widen(np.array([-100.0, 100.0]))
    for part in made.replay.memory[:4]:
        part[:] = np.random.default_rng(2).uniform(-1, 1, part.shape)
    return made


def new(rounds: int = 100, **parameters: Any) -> TD3Learner:
    """One for two copies and so many decisions of each, with an empty replay."""
    return TD3Learner(TD3(**{"net_arch": (8, 8), "random_steps": 0, **parameters}), INPUTS, BOX, 2, 0, rounds)


def drawn(updates: int) -> tuple[Integers, Floats]:
    """What so many updates are given: where their transitions begin in the replay, and noise."""
    generator = np.random.default_rng(3)
    return generator.integers(150, size=(updates, 6)), generator.normal(size=(updates, 6, 2)).astype(np.float32)


def goals(made: TD3Learner, batch: Batch, normal: Floats) -> list[float]:
    """The targets of a batch of transitions."""
    work = TD3Buffers.of(made.networks, len(batch.returns))
    noise = Noise(normal.astype(np.float32), made.schedule.spread, made.schedule.limit)
    batch = batch._replace(bounds=made.replay.memory.bounds)
    targets(made.actor.target, made.critics.target, made.networks, batch, noise, work)
    return [float(goal) for goal in work.goal]


def nothing(returns: list[float], discount: list[float]) -> Batch:
    rows = len(returns)
    states, actions = np.zeros((rows, INPUTS), np.float32), np.zeros((rows, 2), np.float32)
    bounds = np.array([-np.inf, np.inf], np.float32)
    return Batch(states, actions, np.array(returns, np.float32), states, np.array(discount, np.float32), bounds)


@pytest.mark.parametrize("constants", [(1.0, 2.0), (2.0, 1.0)])
def test_targets_by_hand(constants: tuple[float, float]) -> None:
    """Critics that are c + sum of action, actor that is tanh(b): everything can be added up."""
    made = learner(target_policy_noise=0.5, target_noise_clip=0.2)
    made.actor.target[:], made.critics.target[:] = 0, 0
    views(made.actor.target, made.networks.actor)[-1][:] = 0.5, 3.0
    for which, constant in enumerate(constants):
        parts = views(made.critics.target, made.networks.critics[which])
        # through two ReLU layers: relu(1 + sum of action) comes out as it is
        parts[0][INPUTS:, 0] = parts[1][0] = parts[2][0, 0] = parts[4][0, 0] = 1
        parts[5][0] = constant
    noise = np.array([[1.0, 0.1], [0.0, 0.0]])  # 0.5 clipped to 0.2, and 0.05
    first, second = np.tanh(0.5) + 0.2, min(np.tanh(3.0) + 0.05, 1.0)
    goal = goals(made, nothing([0.5, -2], [0.5, 0]), noise)
    assert goal == pytest.approx([0.5 + 0.5 * (1 + 1 + first + second), -2], rel=1e-6)


@pytest.mark.parametrize(("recipe", "expected"), [({"reward_scale": 2.0}, [-0.6, 0.4]), ({"gamma": 1}, [-50, 50])])
def test_targets_lie_among_the_rewards_that_were_seen(recipe: dict[str, Any], expected: list[float]) -> None:
    """With gamma = 1 they are sums of rewards, and know no bounds."""
    made = new(**recipe)
    made.replay.widen(np.array([0.1, 0.2]))
    made.replay.widen(np.array([-0.3, 0.0]))
    assert goals(made, nothing([-50, 50], [0, 0]), np.zeros((2, 2))) == pytest.approx(expected)


def test_the_actor_moves_every_second_update_and_targets_with_it() -> None:
    made = learner(tau=0.25, averaging=0.5)
    followers = (made.actor.online, made.actor.target, made.actor.average, made.critics.target)
    before = [part.copy() for part in followers]
    first, normal = drawn(2)
    made.update(first[:1], normal[:1])
    assert all(map(np.array_equal, before, followers))
    critics = made.critics.online.copy()
    made.update(first[1:], normal[1:])
    assert not np.array_equal(critics, made.critics.online)
    assert not np.array_equal(before[0], made.actor.online)
    for old, now, online, share in (
        (before[1], made.actor.target, made.actor.online, 0.25),
        (before[2], made.actor.average, made.actor.online, 0.5),
        (before[3], made.critics.target, made.critics.online, 0.25),
    ):
        assert now == pytest.approx((1 - share) * old + share * online, rel=1e-5, abs=1e-7)


def test_updates_in_one_call_and_one_by_one_are_the_same() -> None:
    together, apart = learner(), learner()
    first, normal = drawn(7)
    together.update(first, normal)
    for row in range(7):
        apart.update(first[row : row + 1], normal[row : row + 1])
    for ours, theirs in zip((*together.actor, *together.critics), (*apart.actor, *apart.critics), strict=True):
        assert np.array_equal(ours, theirs)


def test_weights_move_as_with_torchs_adam() -> None:
    """Two updates: both of the critics, one of the actor with the critics as they are then; Adam from 1."""
    made, (first, normal) = learner(learning_rate=0.01, learning_rate_final=0.001), drawn(2)
    critics = torch.from_numpy(made.critics.online.copy()).requires_grad_()
    actor = torch.from_numpy(made.actor.online.copy()).requires_grad_()
    adams = torch.optim.Adam([critics], 0.01), torch.optim.Adam([actor], 0.01)
    into, work = np.zeros_like(made.critics.online), TD3Buffers.of(made.networks, 6)
    for row in range(2):
        batch = made.replay.batch(first[row])
        noise = Noise(normal[row], made.schedule.spread, made.schedule.limit)
        targets(made.actor.target, made.critics.target, made.networks, batch, noise, work)
        critic_gradient(critics.detach().numpy(), made.networks, batch, work, into)
        critics.grad = torch.from_numpy(into.copy())
        rate = 0.01 * 0.1 ** (row / 99)
        for adam in adams:
            adam.param_groups[0]["lr"] = rate
        adams[0].step()
    into = np.zeros_like(made.actor.online)
    numbers = (actor.detach().numpy(), critics.detach().numpy())
    actor_gradient(*numbers, made.networks, batch, made.schedule.penalty, work, into)
    actor.grad = torch.from_numpy(into)
    adams[1].step()
    made.update(first, normal)
    assert made.critics.online == pytest.approx(critics.detach().numpy(), rel=0, abs=1e-6)
    assert made.actor.online == pytest.approx(actor.detach().numpy(), rel=0, abs=1e-6)


def test_first_weights_are_bounded_by_their_inputs_and_the_actors_last_are_small() -> None:
    made = new(net_arch=(64, 16))
    for flat, layers, inputs, last in (
        (made.actor.online, made.networks.actor, INPUTS, 0.1),
        (made.critics.online, made.networks.critics[0], INPUTS + 2, 1.0),
        (made.critics.online, made.networks.critics[1], INPUTS + 2, 1.0),
    ):
        parts = views(flat, layers)
        for matrix, bound in zip(parts[::2], (inputs**-0.5, 64**-0.5, last * 16**-0.5), strict=True):
            assert 0.8 * bound < np.abs(matrix).max() <= bound
        assert not any(bias.any() for bias in parts[1::2])
    assert not np.array_equal(*np.split(made.critics.online, 2))


def test_the_policy_spans_the_box_and_is_frozen() -> None:
    """It has the averaged weights."""
    made = learner()
    made.actor.average[:] = np.random.default_rng(4).normal(size=made.actor.online.shape)
    policy = made.policy()
    observation = np.random.default_rng(0).normal(size=(50, INPUTS))
    vectors = policy.act(observation)
    flat, x = torch.from_numpy(made.actor.average.copy()), torch.from_numpy(observation).float()
    squashed = torch.tanh(perceptron(flat, made.networks.actor, x)).numpy()
    made.actor.average[:] += 1
    np.testing.assert_allclose(vectors, np.array([0, 2]) + squashed * [1, 2], rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(policy.act(observation), vectors)


def test_actions_in_training_are_of_the_current_weights_with_noise_within_the_box() -> None:
    made = learner()
    made.actor.average[:] = 0  # the current ones are others
    observation, noise = (np.random.default_rng(seed).normal(size=(50, size)) for seed, size in ((0, INPUTS), (1, 2)))
    flat, x = torch.from_numpy(made.actor.online), torch.from_numpy(observation).float()
    squashed = torch.tanh(perceptron(flat, made.networks.actor, x)).numpy()
    assert made.explored(observation, noise) == pytest.approx(np.clip(squashed + noise, -1, 1), abs=1e-5)


def test_noise_that_lasts_is_in_every_second_copy_and_of_the_same_size() -> None:
    """The correlation of 1,000 decisions in turn has a standard error of at most .03, and their spread of .1."""
    observation = np.zeros((2, INPUTS))

    def noise(**parameters: Any) -> Floats:
        made = new(rounds=1000, exploration_noise=0.01, **parameters)
        first = np.array([made.act(observation)[:, 0] for _ in range(1000)])  # its axis spans [-1, 1]
        return first - made.explored(observation, np.zeros((2, 2)))[:, 0]

    fresh, lasting = noise(), noise(lasting_noise=0.9)
    np.testing.assert_array_equal(lasting[:, 0], fresh[:, 0])
    assert np.corrcoef(lasting[:-1, 1], lasting[1:, 1])[0, 1] == pytest.approx(0.9, abs=0.06)
    assert np.corrcoef(fresh[:-1, 1], fresh[1:, 1])[0, 1] == pytest.approx(0, abs=0.1)
    assert lasting[:, 1].std() == pytest.approx(fresh[:, 1].std(), rel=0.3)


def test_a_training_that_resumes_has_the_earlier_actor_which_rests_at_first() -> None:
    earlier = new(random_steps=4).policy()
    resumed = new(random_steps=4, batch_size=6)
    resumed.resume(earlier)
    seen = np.random.default_rng(1).normal(size=(5, INPUTS))
    np.testing.assert_array_equal(resumed.policy().act(seen), earlier.act(seen))
    explored = resumed.explored(seen, np.zeros((5, 2)))
    np.testing.assert_allclose(BOX.low + (explored + 1) / 2 * np.array([2, 4]), earlier.act(seen), rtol=1e-5)
    resumed.replay.widen(np.array([-100.0, 100.0]))
    critics = resumed.critics.online.copy()
    resumed.update(*drawn(resumed.schedule.still))
    assert (resumed.critics.online != critics).any()
    np.testing.assert_array_equal(resumed.policy().act(seen), earlier.act(seen))
    resumed.update(*drawn(4))
    assert (resumed.policy().act(seen) != earlier.act(seen)).any()


def test_an_actor_of_another_size_is_refused() -> None:
    with pytest.raises(Unsuitable, match="has 8 and 8 hidden units, and 4 are needed"):
        new(net_arch=(4,)).resume(new().policy())


def test_a_training_goes_on_where_an_earlier_one_ended() -> None:
    earlier = learner(random_steps=4, exploration_noise=0.5, exploration_noise_final=0.1)
    earlier.replay.count, earlier._done = 100, 50
    earlier.update(*drawn(101))
    kept = {name: array.copy() for name, array in earlier.kept().items()}
    later = new(random_steps=4, batch_size=6, exploration_noise=0.5, exploration_noise_final=0.1, gradient_steps=2)
    assert later.go_on(kept)
    for own, other in ((later.actor, earlier.actor), (later.critics, earlier.critics)):
        for name in ("online", "target", "average", "mean", "square"):
            np.testing.assert_array_equal(getattr(own, name), getattr(other, name))
    rates = [
        each.schedule.rate * each.schedule.decay ** (each._count - each.schedule.begun) for each in (later, earlier)
    ]
    assert rates[0] == pytest.approx(max(rates[1], 10**-3.5))
    assert later._noise[[0, -1]] == pytest.approx([0.5 - 0.4 * 49 / 99, 0.1])
    seen = np.random.default_rng(1).normal(size=(5, INPUTS))
    np.testing.assert_array_equal(later.policy().act(seen), earlier.policy().act(seen))
    before = later.actor.online.copy()
    later.act(seen[:2])  # no random actions and no wait: it learns from what was kept
    later.learn(seen[:2], np.zeros((2, 2)), Transition(seen[:2], np.zeros(2), seen[:2], np.zeros(2, np.int8)))
    assert later._count > 100
    assert (later.actor.online != before).any()
    last = later.schedule.rate * later.schedule.decay ** (200 - 1)
    assert last == pytest.approx(1e-4, rel=0.05)


_OTHERS = [{"net_arch": (4,)}, {"gamma": 0.5}, {"n_steps": 2}, {"reward_scale": 1.0}, {"layer_norm": True}]


@pytest.mark.parametrize("other", _OTHERS)
def test_a_training_by_another_recipe_does_not_go_on(other: dict[str, Any]) -> None:
    earlier = learner()
    earlier.replay.count = 100
    earlier._done = 1
    assert new().go_on(earlier.kept())
    assert not new(**other).go_on(earlier.kept())
