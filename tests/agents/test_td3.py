"""TD3: its budget, its noise, the same bits, and a task that it learns. Arithmetic: see the tests of its learner."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.line_task import Probe, line

from stlbench.contract import Array, Policy, Training, Transition, Unsuitable
from stlbench.rollout.environment import BatchEnvironment
from stlbench.rollout.referee import Referee
from stlbench.task import build_method
from stlbench_agents.policies import ActorPolicy
from stlbench_agents.replay import Memory
from stlbench_agents.td3 import TD3
from stlbench_agents.td3_learner import TD3Learner

CONTINUOUS: dict[str, Any] = {"actions": {"v": {"low": -1, "high": 1}}}


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


def test_with_gamma_1_rewards_still_arrive_in_the_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    """Weighted by 1 - gamma they would all be 0, and every policy as good as any other."""
    stored = list[Array]()

    def update(self: TD3Learner, memory: Memory, *others: Any) -> None:
        stored.append(memory.reward)

    monkeypatch.setattr(TD3Learner, "update", update)
    trained = Trained(80, copies=4, random_steps=4, gamma=1.0, reward_scale=3.0)
    assert np.abs(stored[-1]).max() > 0.1
    assert len(trained.reports) == 4


def test_a_grid_is_refused() -> None:
    task = line()
    training = Training(lambda n: BatchEnvironment(task, Probe(task.specification), n, 0), 100, 0, lambda *given: None)
    with pytest.raises(Unsuitable, match="the task's actions v are a grid, and this agent's are continuous"):
        TD3().train(training)
