"""A training for the sake of what it loads: the agent trains as ever, the task hardly moves, and nothing is kept."""

from __future__ import annotations

import numpy as np
from helpers.line_task import Probe, line

from stlbench.contract import Agent, Policy, Training, Transition
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.rehearsal import rehearse


class Scribe(Agent):
    """Writes down what it is given."""

    def train(self, training: Training) -> Policy:
        environment = training.make(4)
        self.given = training
        self.first = environment.reset()
        self.sizes = environment.count, environment.observation_size, environment.hold
        rounds = training.steps // (4 * environment.hold)
        self.seen = [environment.step(np.full(4, 2)) for _ in range(rounds)]
        policy = Policy.__new__(_Nothing)
        training.report(policy, training.steps)
        return policy


class _Nothing(Policy):
    def act(self, observation: np.ndarray) -> np.ndarray:
        return np.zeros(len(observation), dtype=np.int64)


def rehearsed(steps: int, hold: int = 1) -> tuple[Scribe, BatchEnvironment]:
    task, agent, made = line(hold=hold), Scribe(), list[BatchEnvironment]()

    def make(count: int) -> BatchEnvironment:
        made.append(BatchEnvironment(task, Probe(task.specification), count, 0))
        return made[-1]

    def report(policy: Policy, steps: int) -> None:
        raise AssertionError("a rehearsal reports nothing")

    rehearse(agent, Training(make, steps, 7, report, 20), hold)
    return agent, made[0]


def test_an_agent_trains_1000_decisions_or_its_budget_with_its_seed() -> None:
    assert rehearsed(120)[0].given.seed == 7
    assert len(rehearsed(10**6)[0].seen) == 250  # 4 copies each
    assert len(rehearsed(10**6, hold=4)[0].seen) == 250
    assert len(rehearsed(120)[0].seen) == 30


def test_the_task_is_stepped_twice_whatever_the_budget() -> None:
    agent, environment = rehearsed(10**6, hold=4)
    assert environment.taken == 2 * 4 * 4
    assert agent.sizes == (4, environment.observation_size, 4)
    first, second, third = agent.seen[:3]
    assert not np.array_equal(first.observation, second.observation)
    assert all(np.array_equal(a, b) for a, b in zip(second, third, strict=True))


def test_what_an_agent_does_to_a_transition_does_not_come_back() -> None:
    agent, _ = rehearsed(120)
    last: Transition = agent.seen[-1]
    last.observation[:] = np.nan
    assert np.isfinite(agent.seen[-2].observation).all()
