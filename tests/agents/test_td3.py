"""TD3: its targets by hand, its critics beside two plain networks, its budget, and a task that it learns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from helpers.line_task import Probe, line
from torch import nn

from stlbench.contract import ActionBox, Array, Policy, Training, Transition, Unsuitable
from stlbench.rollout.environment import BatchEnvironment
from stlbench.rollout.referee import Referee
from stlbench.task import build_method
from stlbench_agents.actor_critic import ActorCritic, TwinCritic
from stlbench_agents.actor_policy import ActorPolicy
from stlbench_agents.replay import Batch
from stlbench_agents.td3 import TD3

BOX = ActionBox(("v", "w"), (-1.0, 0.0), (1.0, 4.0))
CONTINUOUS: dict[str, Any] = {"actions": {"v": {"low": -1, "high": 1}}}


def learner(**parameters: Any) -> ActorCritic:
    made = ActorCritic(TD3(net_arch=(8, 8), **parameters), 3, BOX, np.random.default_rng(0), 100)
    made.saw(np.array([-100.0, 100.0]))
    return made


def batch(size: int = 6, seed: int = 1) -> Batch:
    generator = np.random.default_rng(seed)
    single = [generator.normal(size=shape).astype(np.float32) for shape in ((size, 3), (size,), (size, 3))]
    discount = generator.choice([0, 0.5], size).astype(np.float32)
    action = generator.uniform(-1, 1, (size, 2)).astype(np.float32)
    return Batch(single[0], action, single[1], single[2], discount)


def plain(critic: TwinCritic, which: int, x: torch.Tensor) -> torch.Tensor:
    """One of the critics as a network of PyTorch's own layers."""
    parts: list[nn.Module] = []
    for matrix, bias in zip(critic.matrices, critic.biases, strict=True):
        layer = nn.Linear(*matrix.shape[1:])
        with torch.no_grad():
            layer.weight.copy_(matrix[which].T)
            layer.bias.copy_(bias[which, 0])
        parts += [layer, nn.ReLU()]
    value: torch.Tensor = nn.Sequential(*parts[:-1])(x)
    return value[:, 0]


def test_both_critics_are_what_two_networks_are() -> None:
    made, of = learner(), batch()
    with torch.no_grad():
        for bias in made.critic.biases:
            bias.uniform_(-1, 1)
    observation, action = torch.from_numpy(of.observation), torch.from_numpy(of.action)
    both = made.critic(observation, action)
    assert both.shape == (2, 6)
    for which in range(2):
        expected = plain(made.critic, which, torch.cat([observation, action], 1))
        torch.testing.assert_close(both[which], expected)
    assert not torch.allclose(both[0], both[1])


def test_targets_by_hand() -> None:
    """Critics that are c + sum of action, actor that is tanh(b): everything can be added up."""
    made = learner(target_policy_noise=0.5, target_noise_clip=0.2)
    with torch.no_grad():
        for network in (made.target_actor, made.target_critic):
            for parameter in network.parameters():
                parameter.zero_()
        made.target_actor[-1].bias.copy_(torch.tensor([0.5, 3.0]))
        made.target_critic.biases[-1].copy_(torch.tensor([[[1.0]], [[2.0]]]))
        # through two ReLU layers: relu(1 + sum of action) comes out as it is
        made.target_critic.matrices[0][:, 3:, 0] = 1
        made.target_critic.biases[0][:, 0, 0] = 1
        made.target_critic.matrices[1][:, 0, 0] = 1
        made.target_critic.matrices[2][:, 0, 0] = 1
    of = Batch(
        np.zeros((2, 3), np.float32),
        np.zeros((2, 2), np.float32),
        np.array([0.5, -2], np.float32),
        np.zeros((2, 3), np.float32),
        np.array([0.5, 0], np.float32),
    )
    noise = np.array([[1.0, 0.1], [0.0, 0.0]])  # 0.5 clipped to 0.2, and 0.05
    first = np.tanh(0.5) + 0.2
    second = min(np.tanh(3.0) + 0.05, 1.0)
    goal = made.targets(of, noise).numpy()
    assert goal == pytest.approx([0.5 + 0.5 * (1 + 1 + first + second), -2], rel=1e-6)


def test_targets_lie_among_the_rewards_that_were_seen() -> None:
    made = ActorCritic(TD3(net_arch=(8, 8), reward_scale=2.0), 3, BOX, np.random.default_rng(0), 100)
    made.saw(np.array([0.1, 0.2]))
    made.saw(np.array([-0.3, 0.0]))
    of = batch()._replace(returns=np.array([-50, 50, 0, 0, 0, 0], np.float32))
    goal = made.targets(of, np.zeros((6, 2))).numpy()
    assert goal[:2] == pytest.approx([-0.6, 0.4])
    assert np.abs(goal).max() <= 0.6 + 1e-6


def test_the_actor_moves_every_second_update_and_targets_with_it() -> None:
    made, of = learner(tau=0.25), batch()
    before = [parameter.detach().clone() for parameter in made.actor.parameters()]
    targets = [parameter.detach().clone() for parameter in made.target_critic.parameters()]
    made.update(of, np.zeros((6, 2)))
    assert all(map(torch.equal, before, made.actor.parameters()))
    assert all(map(torch.equal, targets, made.target_critic.parameters()))
    made.update(of, np.zeros((6, 2)))
    assert not any(map(torch.equal, before, made.actor.parameters()))
    for old, now, online in zip(targets, made.target_critic.parameters(), made.critic.parameters(), strict=True):
        torch.testing.assert_close(now.detach(), 0.75 * old + 0.25 * online.detach())


def test_the_penalty_pulls_the_output_to_0() -> None:
    made, of = learner(action_penalty=7.0), torch.zeros(5, 3)
    with torch.no_grad():
        for parameter in [*made.actor.parameters(), *made.critic.parameters()]:
            parameter.zero_()
        made.actor[-1].bias.copy_(torch.tensor([1.0, 3.0]))
    assert float(made.actor_loss(of).detach()) == pytest.approx(7 * (1 + 9) / 2)


def test_the_policy_spans_the_box_and_is_frozen() -> None:
    made = learner()
    policy = made.policy()
    observation = np.random.default_rng(0).normal(size=(50, 3))
    vectors = policy.act(observation)
    with torch.no_grad():
        squashed = torch.tanh(made.actor(torch.from_numpy(observation).float())).numpy()
        made.actor[-1].bias.add_(1)
    np.testing.assert_allclose(vectors, np.array([0, 2]) + squashed * [1, 2], rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(policy.act(observation), vectors)


class Trained:
    """What the agent did with a budget on the line."""

    def __init__(self, steps: int, seed: int = 3, file: dict[str, Any] | None = None, **parameters: Any) -> None:
        self.task = line(**(CONTINUOUS | (file or {})))
        self.method = build_method(self.task, "raw")
        self.used: list[BatchEnvironment] = []
        self.reports: list[tuple[Policy, int]] = []
        training = Training(self._make, steps, seed, lambda *given: self.reports.append(given), checkpoints=4)
        self.policy = TD3(**parameters).train(training)

    def _make(self, count: int) -> BatchEnvironment:
        self.used.append(BatchEnvironment(self.task, self.method, count, seed=1))
        return self.used[-1]


def test_it_spends_the_budget_and_reports_evenly() -> None:
    trained = Trained(407, copies=4, random_steps=10)
    assert trained.used[0].taken == 404
    assert [steps for _, steps in trained.reports] == [100, 200, 304, 404]
    assert trained.reports[-1][0] is trained.policy


def test_the_same_seed_gives_the_same_policy_bit_for_bit() -> None:
    def weights(seed: int) -> bytes:
        policy = Trained(400, seed, copies=4, random_steps=10).policy
        assert isinstance(policy, ActorPolicy)
        return b"".join(part.tobytes() for layer in policy.layers for part in layer)

    assert weights(5) == weights(5)
    assert weights(5) != weights(6)


@pytest.mark.parametrize(("last", "first_quarter", "last_quarter"), [(None, 0.1, 0.1), (0.02, 0.09, 0.03)])
def test_noise_falls_from_first_to_last_and_differs_among_copies(
    monkeypatch: pytest.MonkeyPatch, last: float | None, first_quarter: float, last_quarter: float
) -> None:
    """With an actor that does not learn, what actions differ by from the policy's is the noise."""
    seen = list[tuple[Array, Array]]()

    def step(self: BatchEnvironment, action: Array) -> Transition:
        seen.append((self.simulator.observe(), action.copy()))
        return original(self, action)

    original = BatchEnvironment.step
    monkeypatch.setattr(BatchEnvironment, "step", step)
    rates = {"learning_rate": 1e-30, "learning_rate_final": 1e-30}
    trained = Trained(4 * 2001, copies=4, random_steps=1, exploration_noise=0.1, exploration_noise_final=last, **rates)
    noise = np.array([action - trained.policy.act(observation) for observation, action in seen[1:]])[..., 0]
    shares = np.array([0.25, 0.75, 1.25, 1.75])
    assert noise[:500].std(0) == pytest.approx(shares * first_quarter, rel=0.2)
    assert noise[-500:].std(0) == pytest.approx(shares * last_quarter, rel=0.2)


def test_it_learns_to_go_to_a_point_and_stay() -> None:
    """From [-3, 3] to within 0.4 of 1 after 8 of 12 steps of at most 0.5; at random from a tenth of the starts."""
    file = {
        "formula": "G[9,12] (abs(x - 1) <= 0.4)",
        "steps": 12,
        "initial": {"box": {"x": [-3, 3]}},
        "starts": 32,
    }
    trained = Trained(16_000, file=file, gamma=0.8)
    satisfaction, robustness = Referee(trained.task, trained.method).select(trained.policy)
    assert satisfaction >= 0.9
    assert robustness >= 0.2


def test_with_gamma_1_targets_are_sums_of_rewards_and_know_no_bounds() -> None:
    made = ActorCritic(TD3(net_arch=(8, 8), gamma=1), 3, BOX, np.random.default_rng(0), 100)
    made.saw(np.array([0.1, 0.2]))
    of = batch()._replace(returns=np.array([-50, 50, 0, 0, 0, 0], np.float32), discount=np.zeros(6, np.float32))
    assert made.targets(of, np.zeros((6, 2))).tolist() == [-50, 50, 0, 0, 0, 0]


def test_with_gamma_1_rewards_still_arrive_in_the_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weighted by 1 - gamma they would all be 0, and every policy as good as any other."""
    stored = list[Batch]()

    def update(self: ActorCritic, batch: Batch, noise: Array) -> None:
        stored.append(batch)

    monkeypatch.setattr(ActorCritic, "update", update)
    trained = Trained(80, copies=4, random_steps=4, gamma=1.0, reward_scale=3.0)
    rewards = np.concatenate([batch.returns for batch in stored])
    assert np.abs(rewards).max() > 0.1
    assert len(trained.reports) == 4


def test_a_grid_is_refused() -> None:
    task = line()
    training = Training(lambda n: BatchEnvironment(task, Probe(task.specification), n, 0), 100, 0, lambda *given: None)
    with pytest.raises(Unsuitable, match="the task's actions v are a grid, and this agent's are continuous"):
        TD3().train(training)
