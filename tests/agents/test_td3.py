"""TD3: its noise, its rewards, and a task that it learns. Arithmetic: see the tests of its learner."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.line_task import REACH, line

from stlbench.contract import Array, Policy, Training, Transition
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.referee import Referee
from stlbench.task import build_method
from stlbench_agents.td3 import TD3
from stlbench_agents.td3_learner import TD3Learner

TASK = line(**REACH)
RAW = build_method(TASK, "raw")


def trained(steps: int, **parameters: Any) -> Policy:
    make = lambda count: BatchEnvironment(TASK, RAW, count, seed=1)  # noqa: E731
    return TD3(**parameters).train(Training(make, steps, 3, lambda policy, at: None, checkpoints=4))


@pytest.mark.parametrize(("last", "first_quarter", "last_quarter"), [(None, 0.1, 0.1), (0.02, 0.09, 0.03)])
def test_noise_falls_from_first_to_last_and_differs_among_copies(
    monkeypatch: pytest.MonkeyPatch, last: float | None, first_quarter: float, last_quarter: float
) -> None:
    """With an actor that does not learn, actions differ from the policy's by the noise alone."""
    seen = list[tuple[Array, Array]]()

    def step(self: BatchEnvironment, action: Array) -> Transition:
        seen.append((self.simulator.observe(), action.copy()))
        return original(self, action)

    original = BatchEnvironment.step
    monkeypatch.setattr(BatchEnvironment, "step", step)
    frozen = {"learning_rate": 1e-30, "learning_rate_final": 1e-30, "net_arch": (8,), "batch_size": 2}
    noisy = {"copies": 4, "random_steps": 1, "exploration_noise": 0.1, "exploration_noise_final": last}
    policy = trained(4 * 2001, **noisy, **frozen)
    noise = np.array([action - policy.act(observation) for observation, action in seen[1:]])[..., 0]
    shares = np.array([0.25, 0.75, 1.25, 1.75])
    assert noise[:500].std(0) == pytest.approx(shares * first_quarter, rel=0.2)
    assert noise[-500:].std(0) == pytest.approx(shares * last_quarter, rel=0.2)


def test_it_learns_to_go_to_a_point_and_stay() -> None:
    """At random, a tenth of the starts satisfy the formula."""
    satisfaction, robustness = Referee(TASK, RAW).select(trained(16_000, gamma=0.8))
    assert satisfaction >= 0.9
    assert robustness >= 0.2


def test_with_gamma_1_rewards_still_arrive_in_the_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weighted by 1 - gamma they would all be 0, and every policy as good as any other."""
    stored = list[Array]()
    monkeypatch.setattr(TD3Learner, "update", lambda self, *_: stored.append(self.replay.memory.reward))
    trained(80, copies=4, random_steps=4, gamma=1.0, reward_scale=3.0)
    assert np.abs(stored[-1]).max() > 0.1
