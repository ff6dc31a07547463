"""Every agent that learns: a policy that is restored from a file acts the same, bit for bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stlbench.contract import Actions, Agent, Policy, Training, Unsuitable
from stlbench.records import npz
from stlbench.rollout.environment import BatchEnvironment
from stlbench.testing.line import FORMS, Nearness, line_task
from stlbench_agents.dqn import DQN
from stlbench_agents.independent import DQNPerRobot
from stlbench_agents.sb3_continuous import SB3PPO, SB3SAC, SB3TD3
from stlbench_agents.sb3_dqn import SB3DQN
from stlbench_agents.td3 import TD3

GRID, BOX, ROBOTS = (line_task(form) for form in FORMS)

TRAININGS = {
    "dqn": (GRID, DQN(net_arch=(16,))),
    "dqn, additive": (ROBOTS, DQN(head="additive", net_arch=(16, 8))),
    "dqn-per-robot": (ROBOTS, DQNPerRobot(net_arch=(16,))),
    "dqn-per-robot with one robot": (GRID, DQNPerRobot(net_arch=(16,))),
    "td3": (BOX, TD3(net_arch=(16, 24))),
    "sb3-dqn": (GRID, SB3DQN(net_arch=(16,))),
    "sb3-td3": (BOX, SB3TD3(net_arch=(16,))),
    "sb3-sac": (BOX, SB3SAC(net_arch=(16, 24))),
    "sb3-ppo": (BOX, SB3PPO(net_arch=(16,), n_steps=50)),
}


@pytest.mark.parametrize("name", TRAININGS)
def test_a_restored_policy_acts_the_same(name: str, tmp_path: Path) -> None:
    task, agent = TRAININGS[name]
    method = Nearness(task.specification)
    size = BatchEnvironment(task, method, 1, 0).observation_size
    make = lambda count: BatchEnvironment(task, method, count, 1)  # noqa: E731
    policy = agent.train(Training(make, 2000, 2, lambda policy, steps: None, 3))
    again = through_a_file(agent, policy, task.actions, tmp_path / "policy.npz")
    assert again is not policy
    generator = np.random.default_rng(3)
    for rows in (1, 7, 1064):
        observation = generator.uniform(-1.5, 1.5, (rows, size))
        one, other = policy.act(observation), again.act(observation)
        assert (one.dtype, one.shape, one.tobytes()) == (other.dtype, other.shape, other.tobytes())
    assert len(np.unique(one, axis=0)) > 1  # else it would show nothing


def through_a_file(agent: Agent, policy: Policy, actions: Actions, path: Path) -> Policy:
    arrays = policy.arrays()
    assert arrays is not None
    npz.write(path, arrays)
    with np.load(path) as file:
        return type(agent).restore(dict(file), actions)


@pytest.mark.parametrize(
    ("name", "other", "message"),
    [
        ("dqn", ROBOTS, "the policy chooses among 5 actions, the task has 3 x 3"),
        ("dqn, additive", GRID, "the policy chooses among 3 x 3 actions, the task has 5"),
        ("dqn", BOX, "continuous, and this agent chooses from a grid"),
        ("td3", GRID, "are a grid, and this agent's are continuous"),
    ],
)
def test_other_actions_are_refused(name: str, other: object, message: str) -> None:
    task, agent = TRAININGS[name]
    make = lambda count: BatchEnvironment(task, Nearness(task.specification), count, 1)  # noqa: E731
    policy = agent.train(Training(make, 2000, 2, lambda policy, steps: None, 1))
    arrays = policy.arrays()
    assert arrays is not None
    with pytest.raises(Unsuitable, match=message):
        type(agent).restore(arrays, other.actions)  # type: ignore[attr-defined]
