"""dqn: training as a whole."""

from __future__ import annotations

import hashlib
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from stlbench.contract import Integers, Policy, Training, Transition
from stlbench.rollout.environment import BatchEnvironment
from stlbench.rollout.referee import Referee
from stlbench.task import build_agent, build_method, load_task
from stlbench_agents.dqn import DQN
from stlbench_agents.q_learner import GreedyPolicy


def training(
    steps: int = 1600,
    seed: int = 0,
    checkpoints: int = 1,
    report: Callable[[Policy, int], None] = lambda policy, steps: None,
    starts: int = 5,
) -> Training:
    task = load_task("hold-disc")
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
        path = os.pathsep.join([str(Path(__file__).parent), *(part for part in sys.path if part)])
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

        task = load_task("hold-disc")
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
        task = load_task("hold-disc")
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
