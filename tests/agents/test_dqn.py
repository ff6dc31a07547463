"""dqn: an update against the loss written out in torch, and training as a whole."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import plain_q
import pytest
from numpy.typing import NDArray

from stlbench import problem
from stlbench.contract import ActionGrid, Environment, Integers, Policy, Training, Transition
from stlbench.environment import BatchEnvironment
from stlbench.referee import Referee
from stlbench.trial import build_agent, build_method
from stlbench_agents.dqn import DQN, Learner
from stlbench_agents.network import GreedyPolicy, Head
from stlbench_agents.replay import Batch

GRID = ActionGrid(("v", "w"), ((-1.0, 0.0, 1.0), (0.0, 1.0)))
INPUTS, ROWS = 4, 32


def learner(updates: int = 100, seed: int = 0, **recipe: Any) -> Learner:
    shape = cast(Environment, SimpleNamespace(observation_size=INPUTS, actions=GRID))
    sizes: dict[str, Any] = {"net_arch": (12, 8), "batch_size": ROWS}
    return Learner(DQN(**(sizes | recipe)), shape, seed, updates)


def batch(seed: int, size: int = ROWS) -> Batch:
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


def plain_gradient(recipe: DQN, online: NDArray[Any], target: NDArray[Any], of: Batch) -> NDArray[Any]:
    """Of the loss as the recipe has it, with returns scale (1 - gamma) (r + gamma r' + ...), float64."""
    shape = plain_q.Shape(INPUTS, recipe.net_arch, GRID.shape, recipe.head)
    returns = recipe.reward_scale * (1 - recipe.gamma) * of.returns.astype(np.float64)
    discount = np.where(of.ended & (recipe.time_limit == "terminal"), 0, of.discount)
    return plain_q.gradient(
        shape, online, target, of.observation, of.action, returns, of.arrived, discount, recipe.double
    )


def flat(policy: GreedyPolicy) -> NDArray[Any]:
    """A copy of a policy's weights as one vector, in float64."""
    return np.concatenate([weight.ravel() for weight in policy.weights]).astype(np.float64)


class TestLearner:
    @pytest.mark.parametrize("head", ["joint", "additive"])
    @pytest.mark.parametrize("double", [True, False])
    @pytest.mark.parametrize("time_limit", ["bootstrap", "terminal"])
    def test_the_gradient_is_that_of_the_loss(self, head: Head, double: bool, time_limit: str) -> None:
        # tau = 0 leaves the target network at the first weights, so that it differs from the online network
        ours = learner(head=head, double=double, time_limit=time_limit, tau=0, learning_rate=0.01, gamma=0.9)
        target = flat(ours.policy)
        for i in range(20):
            ours.update(batch(100 + i))
        online = flat(ours.policy)
        assert np.abs(online - target).max() > 0.01
        for seed in range(5):
            expected = plain_gradient(ours.recipe, online, target, batch(seed))
            assert np.linalg.norm(expected) > 0.01
            assert ours.gradient(batch(seed)) == pytest.approx(expected, abs=1e-6)

    def test_a_hard_update_copies_the_weights_every_so_often(self) -> None:
        ours = learner(tau=1, target_update_interval=3, learning_rate=0.01)
        target = flat(ours.policy)
        for update in range(1, 8):
            ours.update(batch(update))
            if update in (3, 6):
                target = flat(ours.policy)
            assert ours.target == pytest.approx(target, rel=0, abs=2e-7)
            assert update in (3, 6) or np.abs(flat(ours.policy) - target).max() > 5e-3
            expected = plain_gradient(ours.recipe, flat(ours.policy), target, batch(0))
            assert ours.gradient(batch(0)) == pytest.approx(expected, abs=1e-6)

    def test_a_soft_update_moves_the_target_by_tau(self) -> None:
        ours = learner(tau=0.25, learning_rate=0.01)
        target = flat(ours.policy)
        for update in range(6):
            ours.update(batch(update))
            target = 0.75 * target + 0.25 * flat(ours.policy)
        expected = plain_gradient(ours.recipe, flat(ours.policy), target, batch(0))
        assert ours.gradient(batch(0)) == pytest.approx(expected, abs=1e-6)

    def test_a_soft_update_every_so_often(self) -> None:
        ours = learner(tau=0.5, target_update_interval=2, learning_rate=0.01)
        target = flat(ours.policy)
        for update in range(1, 6):
            ours.update(batch(update))
            if update in (2, 4):
                target = 0.5 * target + 0.5 * flat(ours.policy)
            assert ours.target == pytest.approx(target, rel=0, abs=1e-6)

    def test_the_gradient_is_clipped_by_its_norm(self) -> None:
        """Adam's first step is rate * g / (|g| + 1e-8): with the norm clipped to 1e-8 its size shows the clipping."""
        ours = learner(max_grad_norm=1e-8, learning_rate=0.5)
        before, gradient = flat(ours.policy), ours.gradient(batch(0)).astype(np.float64)
        ours.update(batch(0))
        clipped = gradient * 1e-8 / np.linalg.norm(gradient)
        step = flat(ours.policy) - before
        # Without clipping every entry would be close to .5 in size.
        assert step == pytest.approx(-0.5 * clipped / (np.abs(clipped) + 1e-8), abs=1e-3)

    @pytest.mark.parametrize("updates", [1, 5])
    def test_the_rate_falls_geometrically_from_the_first_update_to_the_last(self, updates: int) -> None:
        """On one and the same gradient each step of Adam is the rate itself.

        The gradient stays as it is to 1e-3 or so, since the weights hardly move; the largest entry shows it best.
        """
        ours = learner(updates, learning_rate=1e-3, learning_rate_final=1e-5, tau=0, averaging=0)
        entry = int(np.abs(ours.gradient(batch(0))).argmax())
        steps = []
        for _ in range(updates):
            before = float(ours.online[entry])
            ours.update(batch(0))
            steps.append(abs(float(ours.online[entry]) - before))
        expected = np.geomspace(1e-3, 1e-5, 5) if updates == 5 else [1e-3]
        assert steps == pytest.approx(expected, rel=0.02)

    def test_what_is_reported_is_averaged_first_evenly_then_exponentially(self) -> None:
        """With averaging .75: the mean of all weights so far up to the fourth update, then .75 old + .25 new."""
        ours = learner(averaging=0.75, learning_rate=0.01)
        history: list[NDArray[Any]] = []
        expected = np.zeros(0)
        for update in range(6):
            ours.update(batch(update))
            history.append(flat(ours.policy))
            expected = np.mean(history, axis=0) if update < 4 else 0.75 * expected + 0.25 * history[-1]
            assert flat(ours.reported) == pytest.approx(expected, rel=0, abs=1e-6)
        assert np.abs(flat(ours.policy) - expected).max() > 0.01

    def test_without_averaging_the_current_weights_are_reported(self) -> None:
        ours = learner(averaging=0, learning_rate=0.01)
        before = flat(ours.policy)
        ours.update(batch(0))
        assert np.array_equal(flat(ours.reported), flat(ours.policy))
        assert not np.array_equal(flat(ours.reported), before)


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

    def test_another_process_gets_the_same_bits(self) -> None:
        """It takes the compiled code from numba's cache where this process may have compiled it itself."""
        policy = cast(GreedyPolicy, DQN(head="additive").train(training(seed=3)))
        here = hashlib.sha256(b"".join(weight.tobytes() for weight in policy.weights)).hexdigest()
        program = (
            "import hashlib, test_dqn as t; policy = t.DQN(head='additive').train(t.training(seed=3));"
            "print(hashlib.sha256(b''.join(weight.tobytes() for weight in policy.weights)).hexdigest())"
        )
        path = os.pathsep.join(part for part in sys.path if part)
        ran = subprocess.run(
            [sys.executable, "-c", program], env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True
        )
        assert (ran.returncode, ran.stdout.strip()) == (0, here), ran.stderr

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
        """24,000 steps, less than a second.

        Measured on seeds 0..7: satisfaction .98 (once) or 1 and mean robustness .37 to .40 (at most .40 can be had from
        these starts); of policies with fresh weights .03, .45, 0, 0, .84, .06, .19, .19 and from -6.4 to .23. The
        bounds lie between with room on both sides.
        """
        task = problem.load("hold-disc")
        referee = Referee(task, build_method(task, "funnel"))
        frozen: dict[str, Any] = {"learning_rate": 1e-12, "learning_rate_final": 1e-12}
        fresh = referee.select(DQN(head="additive", **frozen).train(training(160, seed, starts=seed)))
        learnt = referee.select(build_agent(task, "dqn").train(training(24_000, seed, starts=seed)))
        assert fresh[0] < 0.75
        assert fresh[1] < 0.1
        assert learnt[0] > 0.85
        assert learnt[1] > 0.2


def test_the_literal_recipe_of_the_paper_trains() -> None:
    """Algorithm 2, with the parameters that the docstring of DQN names for it."""
    agent = DQN(double=False, n_steps=1, tau=1, target_update_interval=1000, averaging=0, copies=1)
    policy = agent.train(training(300))
    action = policy.act(np.zeros((2, 5)))
    assert action.shape == (2,)
    assert math.isfinite(float(action.sum()))
