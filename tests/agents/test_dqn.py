"""dqn: the loss and its gradient written out, Adam against torch's, and training as a whole."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import torch

from stlbench import problem
from stlbench.contract import ActionGrid, Environment, Integers, Policy, Training, Transition
from stlbench.environment import BatchEnvironment
from stlbench.referee import Referee
from stlbench.trial import build_agent, build_method
from stlbench_agents.dqn import DQN, Adam, Learner
from stlbench_agents.network import GreedyPolicy, Head
from stlbench_agents.replay import Batch

GRID = ActionGrid(("v", "w"), ((-1.0, 0.0, 1.0), (0.0, 1.0)))
INPUTS = 4


def learner(updates: int = 100, seed: int = 0, **recipe: Any) -> Learner:
    shape = cast(Environment, SimpleNamespace(observation_size=INPUTS, actions=GRID))
    return Learner(DQN(**({"net_arch": (12, 8)} | recipe)), shape, seed, updates)


def batch(seed: int, size: int = 32) -> Batch:
    """Random transitions, a third of them at the end of their episode."""
    generator = np.random.default_rng(seed)
    return Batch(
        generator.normal(size=(size, INPUTS)).astype(np.float32),
        generator.integers(GRID.size, size=size),
        generator.normal(size=size).astype(np.float32),
        generator.normal(size=(size, INPUTS)).astype(np.float32),
        generator.choice(np.array([0.9, 0.81, 0.729], dtype=np.float32), size=size),
        generator.random(size) < 1 / 3,
    )


def weights_of(policy: GreedyPolicy) -> list[torch.Tensor]:
    """A copy, in float64."""
    return [torch.from_numpy(weight.copy()).double() for weight in policy.weights]


def all_q(head: Head, weights: list[torch.Tensor], x: torch.Tensor) -> torch.Tensor:
    """Q of all six actions, (B, 6): index 2 i + j."""
    w1, b1, w2, b2, w3, b3 = weights
    outputs = torch.relu(torch.relu(x @ w1 + b1) @ w2 + b2) @ w3.T + b3
    if head == "joint":
        return outputs
    v, a, b = outputs[:, :1], outputs[:, 1:4], outputs[:, 4:6]
    a, b = a - a.mean(dim=1, keepdim=True), b - b.mean(dim=1, keepdim=True)
    return torch.stack([v[:, 0] + a[:, i] + b[:, j] for i in range(3) for j in range(2)], dim=1)


def plain_gradient(recipe: DQN, online: list[torch.Tensor], target: list[torch.Tensor], of: Batch) -> torch.Tensor:
    """Of 1/2 mean (Q(s, a) - y)^2, y = scale (1 - gamma) (r + gamma r' + ...) + gamma^n Q_target(s_n, a*), float64.

    a* is the maximiser of the online network for double DQN, else of the target network.
    """
    online = [weight.clone().requires_grad_() for weight in online]
    head = recipe.head
    seen, arrived = torch.from_numpy(of.observation).double(), torch.from_numpy(of.arrived).double()
    with torch.no_grad():
        later = all_q(head, target, arrived)
        chosen = (all_q(head, online, arrived) if recipe.double else later).argmax(dim=1)
        bootstrap = torch.from_numpy(of.discount).double() * later[torch.arange(len(later)), chosen]
        if recipe.time_limit == "terminal":
            bootstrap[torch.from_numpy(of.ended)] = 0
        y = recipe.reward_scale * (1 - recipe.gamma) * torch.from_numpy(of.returns).double() + bootstrap
    q = all_q(head, online, seen)[torch.arange(len(seen)), torch.from_numpy(of.action)]
    loss = 0.5 * ((q - y) ** 2).mean()
    return torch.cat([part.ravel() for part in torch.autograd.grad(loss, online)])


class TestLearner:
    @pytest.mark.parametrize("head", ["joint", "additive"])
    @pytest.mark.parametrize("double", [True, False])
    @pytest.mark.parametrize("time_limit", ["bootstrap", "terminal"])
    def test_the_gradient_is_that_of_the_loss(self, head: Head, double: bool, time_limit: str) -> None:
        # tau = 0 leaves the target network at the first weights, so that it differs from the online network
        ours = learner(head=head, double=double, time_limit=time_limit, tau=0, learning_rate=0.01, gamma=0.9)
        target = weights_of(ours.policy)
        for i in range(20):
            ours.update(batch(100 + i))
        online = weights_of(ours.policy)
        assert max(float((a - b).abs().max()) for a, b in zip(online, target, strict=True)) > 0.01
        for seed in range(5):
            expected = plain_gradient(ours.recipe, online, target, batch(seed))
            assert float(expected.norm()) > 0.01
            assert ours.gradient(batch(seed)).double().numpy() == pytest.approx(expected.numpy(), abs=1e-6)

    def test_a_hard_update_copies_the_weights_every_so_often(self) -> None:
        ours = learner(tau=1, target_update_interval=3, learning_rate=0.01)
        target = weights_of(ours.policy)
        for update in range(1, 8):
            ours.update(batch(update))
            if update in (3, 6):
                target = weights_of(ours.policy)
            expected = plain_gradient(ours.recipe, weights_of(ours.policy), target, batch(0))
            assert ours.gradient(batch(0)).double().numpy() == pytest.approx(expected.numpy(), abs=1e-6)

    def test_a_soft_update_moves_the_target_by_tau(self) -> None:
        ours = learner(tau=0.25, learning_rate=0.01)
        target = weights_of(ours.policy)
        for update in range(6):
            ours.update(batch(update))
            target = [0.75 * old + 0.25 * new for old, new in zip(target, weights_of(ours.policy), strict=True)]
        expected = plain_gradient(ours.recipe, weights_of(ours.policy), target, batch(0))
        assert ours.gradient(batch(0)).double().numpy() == pytest.approx(expected.numpy(), abs=1e-6)

    def test_the_gradient_is_clipped_by_its_norm(self) -> None:
        """Adam's first step is rate * g / (|g| + 1e-8): with the norm clipped to 1e-8 its size shows the clipping."""
        ours = learner(max_grad_norm=1e-8, learning_rate=0.5)
        before, gradient = weights_of(ours.policy), ours.gradient(batch(0)).double()
        ours.update(batch(0))
        clipped = gradient * 1e-8 / gradient.norm()
        step = torch.cat([(b - a).ravel() for a, b in zip(before, weights_of(ours.policy), strict=True)])
        # Without clipping every entry would be close to .5 in size.
        assert step.numpy() == pytest.approx((-0.5 * clipped / (clipped.abs() + 1e-8)).numpy(), abs=1e-3)

    def test_what_is_reported_is_averaged_first_evenly_then_exponentially(self) -> None:
        """With averaging .75: the mean of all weights so far up to the fourth update, then .75 old + .25 new."""
        ours = learner(averaging=0.75, learning_rate=0.01)
        history, expected = [], torch.zeros(0)
        for update in range(6):
            ours.update(batch(update))
            history.append(torch.cat([weight.ravel() for weight in weights_of(ours.policy)]))
            expected = torch.stack(history).mean(dim=0) if update < 4 else 0.75 * expected + 0.25 * history[-1]
            reported = torch.cat([weight.ravel() for weight in weights_of(ours.reported)])
            assert reported.numpy() == pytest.approx(expected.numpy(), abs=1e-5)

    def test_without_averaging_the_current_weights_are_reported(self) -> None:
        ours = learner(averaging=0, learning_rate=0.01)
        ours.update(batch(0))
        pairs = zip(weights_of(ours.reported), weights_of(ours.policy), strict=True)
        assert all(torch.equal(a, b) for a, b in pairs)


class TestAdam:
    def test_against_torch(self) -> None:
        steps, generator = 400, torch.Generator().manual_seed(0)
        ours, theirs = (torch.linspace(-1, 1, 50) for _ in range(2))
        adam, reference = Adam(ours, 1e-2, 1e-4, steps), torch.optim.Adam([theirs.requires_grad_()], lr=1e-2)
        for step in range(steps):
            gradient = torch.randn(50, generator=generator) * 10.0 ** (step % 3 - 3) + 0.001
            for group in reference.param_groups:
                group["lr"] = 1e-2 * (1e-4 / 1e-2) ** (step / (steps - 1))
            theirs.grad = gradient
            reference.step()
            adam.step(gradient.clone())
        assert float((theirs.detach() - torch.linspace(-1, 1, 50)).abs().mean()) > 0.01
        assert ours.numpy() == pytest.approx(theirs.detach().numpy(), rel=1e-4, abs=1e-6)

    def test_the_rate_falls_geometrically_from_the_first_step_to_the_last(self) -> None:
        # For a constant gradient both of Adam's means, unbiased, are those of one sample: each step is the rate itself.
        weights = torch.zeros(1, dtype=torch.float64)
        adam, places = Adam(weights, 1e-2, 1e-6, 5), [0.0]
        for _ in range(5):
            adam.step(torch.tensor([-3.0], dtype=torch.float64))
            places.append(float(weights))
        assert np.diff(places) == pytest.approx([1e-2, 1e-3, 1e-4, 1e-5, 1e-6], rel=1e-5)


def training(
    steps: int = 1600,
    seed: int = 0,
    checkpoints: int = 1,
    report: Callable[[Policy, int], None] = lambda policy, steps: None,
    starts: int = 5,
) -> Training:
    task = problem.load("hold-disc")
    method = build_method(task, "funnel")
    return Training(lambda count: BatchEnvironment(task, method, count, starts), steps, seed, report, checkpoints)


class TestTraining:
    def test_the_same_seed_gives_the_same_bits_and_another_seed_does_not(self) -> None:
        weights = []
        for seed in (3, 3, 4):
            policy = cast(GreedyPolicy, DQN(head="additive").train(training(seed=seed)))
            weights.append(b"".join(weight.tobytes() for weight in policy.weights))
        assert weights[0] == weights[1]
        assert weights[0] != weights[2]

    @pytest.mark.parametrize(
        ("steps", "checkpoints", "expected"), [(1600, 4, [400, 800, 1200, 1600]), (1600, 1, [1600])]
    )
    def test_checkpoints_are_even_and_the_last_is_the_budget(
        self, steps: int, checkpoints: int, expected: list[int]
    ) -> None:
        seen: list[tuple[Policy, int]] = []
        final = DQN().train(training(steps, checkpoints=checkpoints, report=lambda p, s: seen.append((p, s))))
        assert [taken for _, taken in seen] == expected
        assert seen[-1][0] is final

    def test_more_checkpoints_than_decisions_are_as_many_as_decisions(self) -> None:
        seen: list[int] = []
        DQN(copies=16).train(training(64, checkpoints=20, report=lambda p, s: seen.append(s)))
        assert seen == [16, 32, 48, 64]

    def test_a_reported_policy_is_not_changed_by_later_training(self) -> None:
        seen: list[GreedyPolicy] = []
        when_reported: list[list[bytes]] = []

        def report(policy: Policy, steps: int) -> None:
            seen.append(cast(GreedyPolicy, policy))
            when_reported.append([weight.tobytes() for weight in seen[-1].weights])

        DQN().train(training(checkpoints=4, report=report))
        assert [[weight.tobytes() for weight in policy.weights] for policy in seen] == when_reported
        assert when_reported[0] != when_reported[-1]

    def test_exploration_falls_linearly_and_then_stays(self) -> None:
        """From 1 to .1 over the first half: .775 in the middle of its first half, .325 in that of its second.

        The network does not move, so an action that differs from the final policy's was drawn at random; of the
        273 random actions one is the greedy one.
        """
        differs: list[float] = []
        actions: list[Integers] = []
        seen: list[np.ndarray] = []

        class Watched(BatchEnvironment):
            def reset(self) -> np.ndarray:
                seen[:] = [super().reset()]
                return seen[0]

            def step(self, action: Integers) -> Transition:
                actions.append(action)
                transition = super().step(action)
                seen.append(transition.observation)
                return transition

        task = problem.load("hold-disc")
        method = build_method(task, "funnel")
        agent = DQN(
            learning_rate=1e-12,
            learning_rate_final=1e-12,
            exploration_final_eps=0.1,
            exploration_fraction=0.5,
            averaging=0,
            batch_size=2,
            copies=50,
        )
        policy = agent.train(Training(lambda count: Watched(task, method, count, 0), 40_000, 0, lambda p, s: None, 1))
        for observation, action in zip(seen, actions, strict=False):
            differs.append(float(np.mean(policy.act(observation) != action)))
        quarters = np.array(differs).reshape(4, 200).mean(axis=1)
        # 10,000 actions a quarter: a standard deviation of at most .005
        assert quarters == pytest.approx(np.array([0.775, 0.325, 0.1, 0.1]) * (1 - 1 / 273), abs=0.025)
        assert np.mean(differs[:10]) > 0.97

    @pytest.mark.parametrize("seed", [0, 1])
    def test_it_learns_the_comparative_study(self, seed: int) -> None:
        """16,000 steps, a tenth of the quick budget, one second.

        Measured on seeds 0..4: satisfaction 1, .98, 1, .97, 1 and mean robustness .39, .37, .31, .37, .39 (at most
        .40 can be had from these starts); of policies with fresh weights .55, .30, 0, .58, .05 and -.44, -.86, -5.3,
        -.01, -1.8. The bounds lie between with room on both sides.
        """
        task = problem.load("hold-disc")
        referee = Referee(task, build_method(task, "funnel"))
        frozen = {"learning_rate": 1e-12, "learning_rate_final": 1e-12}
        fresh = referee.select(DQN(head="additive", **frozen).train(training(160, seed, starts=seed)))
        learnt = referee.select(build_agent(task, "dqn").train(training(16_000, seed, starts=seed)))
        assert fresh.satisfaction < 0.75
        assert fresh.mean < 0.1
        assert learnt.satisfaction > 0.85
        assert learnt.mean > 0.2


def test_the_literal_recipe_of_the_paper_trains() -> None:
    """Algorithm 2, with the parameters that the docstring of DQN names for it."""
    agent = DQN(double=False, n_steps=1, tau=1, target_update_interval=1000, averaging=0, copies=1)
    policy = agent.train(training(300))
    action = policy.act(np.zeros((2, 5)))
    assert action.shape == (2,)
    assert math.isfinite(float(action.sum()))
