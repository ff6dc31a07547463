"""TD3, SAC and PPO of Stable-Baselines3: what they export, their budget, and a task that one of them learns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.line_task import Probe, line

from stlbench.contract import Policy, Training, Unsuitable
from stlbench.rollout.environment import BatchEnvironment
from stlbench.rollout.referee import Referee
from stlbench.task import build_method
from stlbench_agents.policies import ActorPolicy
from stlbench_agents.sb3_agent import SB3Agent
from stlbench_agents.sb3_continuous import SB3PPO, SB3SAC, SB3TD3

FILE: dict[str, Any] = {
    "formula": "G[9,12] (abs(x - 1) <= 0.4)",
    "steps": 12,
    "initial": {"box": {"x": [-3, 3]}},
    "starts": 32,
    "actions": {"v": {"low": -1, "high": 2}},
}
"""To within 0.4 of 1 after 8 of 12 steps of at most -0.5 or 1."""
SMALL: dict[str, Any] = {"net_arch": (8, 8), "copies": 4}
AGENTS: list[SB3Agent] = [
    SB3TD3(**SMALL, learning_starts=20),
    SB3SAC(**SMALL, learning_starts=20),
    SB3PPO(**SMALL, n_steps=16, batch_size=16),
]


class Trained:
    """What an agent did with a budget on the line."""

    def __init__(self, agent: SB3Agent, steps: int, seed: int = 3) -> None:
        self.task = line(**FILE)
        self.method = build_method(self.task, "raw")
        self.used: list[BatchEnvironment] = []
        self.reports: list[tuple[Policy, int]] = []
        training = Training(self._make, steps, seed, lambda *given: self.reports.append(given), checkpoints=4)
        self.policy = agent.train(training)

    def _make(self, count: int) -> BatchEnvironment:
        self.used.append(BatchEnvironment(self.task, self.method, count, seed=1))
        return self.used[-1]


def name(agent: SB3Agent) -> str:
    return type(agent).__name__


@pytest.mark.parametrize("agent", AGENTS, ids=name)
def test_the_exported_policy_is_what_sb3_predicts(agent: SB3Agent) -> None:
    task = line(**FILE)
    environment = BatchEnvironment(task, build_method(task, "raw"), 4, seed=0)
    model: Any = agent.model(environment, 1)
    model.learn(256)
    observation = np.random.default_rng(0).uniform(-3, 3, (200, environment.observation_size))
    theirs, _ = model.predict(observation.astype(np.float32), deterministic=True)
    ours = agent.exported(model, environment).act(observation)
    np.testing.assert_allclose(ours, theirs, atol=1e-5)
    assert ours.std() > 1e-3


@pytest.mark.parametrize("agent", AGENTS, ids=name)
def test_it_spends_the_budget_and_no_more_and_reports_evenly(agent: SB3Agent) -> None:
    trained = Trained(agent, 600)
    size = agent.copies * agent.rollout
    assert 600 - size < trained.used[0].taken <= 600
    steps = [steps for _, steps in trained.reports]
    assert steps[-1] == trained.used[0].taken
    np.testing.assert_allclose(steps, np.arange(1, 5) * steps[-1] / 4, atol=size)
    assert trained.reports[-1][0] is trained.policy


@pytest.mark.parametrize(("steps", "taken"), [(60, 48), (24, 16), (12, 12), (4, 4)])
def test_a_budget_of_less_than_a_rollout_is_one_rollout(steps: int, taken: int) -> None:
    """In batches of 16, four steps of four copies, while there are as many."""
    trained = Trained(SB3PPO(**SMALL, n_steps=16, batch_size=16), steps)
    assert trained.used[0].taken == taken
    assert trained.reports == [(trained.policy, taken)]


FIRST = [AGENTS[0], *(pytest.param(agent, marks=pytest.mark.slow) for agent in AGENTS[1:])]


@pytest.mark.parametrize("agent", FIRST, ids=name)
def test_the_same_seed_gives_the_same_policy_bit_for_bit(agent: SB3Agent) -> None:
    def weights(seed: int) -> bytes:
        policy = Trained(agent, 300, seed).policy
        assert isinstance(policy, ActorPolicy)
        return b"".join(part.tobytes() for layer in policy.layers for part in layer)

    assert weights(5) == weights(5)
    assert weights(5) != weights(6)


@pytest.mark.slow
def test_it_learns_to_go_to_a_point_and_stay() -> None:
    """A random actor satisfies the formula from about a tenth of the starts."""
    trained = Trained(SB3TD3(copies=4, gamma=0.8), 4000)
    satisfaction, _ = Referee(trained.task, trained.method).select(trained.policy)
    assert satisfaction >= 0.6


@pytest.mark.parametrize("agent", AGENTS, ids=name)
def test_a_grid_is_refused(agent: SB3Agent) -> None:
    task = line()
    environment = BatchEnvironment(task, Probe(task.specification), 4, seed=0)
    with pytest.raises(Unsuitable, match="the task's actions v are a grid, and this agent's are continuous"):
        agent.model(environment, 0)
