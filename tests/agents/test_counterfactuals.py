"""Counterfactual transitions beside the real ones: how they are stored, and that nothing else changes."""

from __future__ import annotations

from typing import cast

import numpy as np
import pytest
from helpers.latch import Latch
from helpers.line_task import Probe, line

from stlbench.contract import RewardMethod, Training
from stlbench.rollout.environment import BatchEnvironment
from stlbench_agents.dqn import DQN
from stlbench_agents.q_learner import GreedyPolicy
from stlbench_agents.training import Counterfactuals

TASK = line(hold=2)


def trained(method: RewardMethod, **recipe: int) -> tuple[bytes, int]:
    """The policy's weights after 60 lock-steps of 4 copies, and the environment steps taken."""
    made = list[BatchEnvironment]()

    def make(count: int) -> BatchEnvironment:
        made.append(BatchEnvironment(TASK, method, count, 3))
        return made[-1]

    agent = DQN(net_arch=(8,), copies=4, batch_size=16, **recipe)  # type: ignore[arg-type]
    policy = cast(GreedyPolicy, agent.train(Training(make, 480, 0, lambda policy, steps: None, 1)))
    return policy.flat.tobytes(), made[0].taken


def test_they_follow_the_real_ones_with_the_same_actions() -> None:
    environment = BatchEnvironment(TASK, Latch(TASK.specification), 4, 3)
    counterfactuals, seen, action = Counterfactuals(environment, 2, 7), environment.reset(), np.array([2, 1, 0, 2])
    transition = environment.step(action)
    observation, actions, joined = counterfactuals.added(seen, action, transition)
    assert counterfactuals.copies == 12
    assert observation.shape == joined.arrived.shape == (12, 4)
    assert np.array_equal(observation[:4], seen)
    assert np.array_equal(joined.reward[:4], transition.reward)
    assert np.array_equal(actions, np.tile(action, 3))
    assert joined.cut[4:].all()


@pytest.mark.parametrize("method", [Probe(TASK.specification), Probe(TASK.specification, 2)])
def test_without_counterfactuals_of_the_method_the_bits_are_the_same(method: RewardMethod) -> None:
    assert trained(method, counterfactuals=0) == trained(method, counterfactuals=1) == trained(method)


def test_with_them_another_policy_is_learned_from_as_many_steps() -> None:
    none, one, two = (trained(Latch(TASK.specification), counterfactuals=times) for times in (0, 1, 2))
    assert len({none[0], one[0], two[0]}) == 3
    assert none[1] == one[1] == two[1] == 480
    assert one == trained(Latch(TASK.specification), counterfactuals=1)
