"""dqn-per-robot: who learns what from whose actions, training as a whole, and one robot, with which it is dqn."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from helpers.pair_task import pair

from stlbench.contract import ActionGrid, Array, Environment, Integers, Policy, Training, Transition
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.referee import Referee
from stlbench.task import build_method, load_task
from stlbench_agents.dqn import DQN, DQNPerRobot, Team
from stlbench_agents.q_policy import GreedyPolicy

COPIES = 16


def team(grid: Any = ((-1.0, 0.0, 1.0), (0.0, 1.0, 2.0, 3.0, 4.0)), **recipe: Any) -> Team:
    """Two robots, with 3 and 5 actions by default, that see 4 numbers."""
    actions = ActionGrid(("v", "w"), grid, (1, 1))
    shape = cast(Environment, SimpleNamespace(observation_size=4, actions=actions, count=COPIES))
    made = DQNPerRobot(net_arch=(8,), batch_size=8, **recipe).learner(shape, shape.count, 0, 100)
    assert isinstance(made, Team)
    return made


def lock_step(generator: np.random.Generator, reward: Array) -> tuple[Array, Transition]:
    wide = generator.normal(size=(COPIES, 4))
    return wide, Transition(wide, reward, wide, np.zeros(COPIES, np.int8))


def test_every_robot_learns_from_its_own_part_of_the_joint_action() -> None:
    made, generator = team(n_steps=1), np.random.default_rng(0)
    joint = np.arange(COPIES) % 15
    observation, transition = lock_step(generator, np.arange(COPIES) * 1.0)
    made.learn(observation, joint, transition, generator)
    first, second = (learner.replay.batch(np.arange(COPIES)) for learner in made.learners)
    assert first.action.tolist() == [index // 5 for index in joint]
    assert second.action.tolist() == [index % 5 for index in joint]
    assert np.array_equal(first.returns, second.returns)
    assert first.returns.std() > 0
    assert np.array_equal(first.observation, second.observation)


def test_the_joint_action_is_that_of_all_robots_and_each_explores_on_its_own() -> None:
    made, generator = team(), np.random.default_rng(1)
    seen = generator.normal(size=(20_000, 4))
    own = [learner.policy().act(seen) for learner in made.learners]
    assert np.array_equal(made.act(seen, 0.0, generator), own[0] * 5 + own[1])
    assert np.array_equal(made.policy().act(seen), own[0] * 5 + own[1])
    explored = made.act(seen, 0.3, generator)
    strayed = explored // 5 != own[0], explored % 5 != own[1]
    # .3 * 2/3 and .3 * 4/5; at the same time only by chance
    assert [part.mean() for part in strayed] == pytest.approx([0.2, 0.24], abs=0.02)
    assert (strayed[0] & strayed[1]).mean() == pytest.approx(0.2 * 0.24, abs=0.01)
    counts = np.bincount(made.act(seen, 1.0, generator), minlength=15)
    assert np.abs(counts / len(seen) - 1 / 15).max() < 0.01


def test_each_robot_finds_the_action_that_pays_whatever_the_other_does() -> None:
    """A reward of two parts, one per robot: best is 2 for the one and 1 for the other."""
    made = team(gamma=0.0, n_steps=1, learning_rate=0.01, learning_rate_final=0.01, averaging=0.9)
    generator = np.random.default_rng(0)
    for _ in range(300):
        seen, _ = lock_step(generator, np.zeros(COPIES))
        joint = made.act(seen, 1.0, generator)
        _, transition = lock_step(generator, -abs(joint // 5 - 2.0) - abs(joint % 5 - 1.0))
        made.learn(seen, joint, transition, generator)
    assert made.policy().act(generator.normal(size=(50, 4))).tolist() == [2 * 5 + 1] * 50


def test_robots_begin_with_weights_of_their_own() -> None:
    first, second = team(grid=((-1.0, 1.0), (-1.0, 1.0))).learners
    assert first.weights.online.shape == second.weights.online.shape
    assert not np.array_equal(first.weights.online, second.weights.online)


def test_with_one_robot_it_is_dqn() -> None:
    task = load_task("hold-disc")

    def train(agent: DQN) -> Policy:
        make = lambda count: BatchEnvironment(task, build_method(task, "funnel"), count, 0)  # noqa: E731
        return agent.train(Training(make, 800, 1, lambda policy, steps: None, 1))

    ours, theirs = train(DQNPerRobot()), train(DQN())
    assert isinstance(ours, GreedyPolicy)
    assert ours.flat.tobytes() == cast(GreedyPolicy, theirs).flat.tobytes()


class _Still(Policy):
    def act(self, observation: Array) -> Integers:
        return np.full(len(observation), 1 * 5 + 2)


def test_two_robots_learn_to_be_where_each_should() -> None:
    task = pair()
    method = build_method(task, "raw")
    referee = Referee(task, method)
    training = Training(lambda n: BatchEnvironment(task, method, n, 5), 16_000, 0, lambda policy, steps: None, 4)
    learnt, still = referee.select(DQNPerRobot().train(training)), referee.select(_Still())
    assert still == (0, pytest.approx(-1, abs=0.5))
    assert learnt[0] > 0.8
