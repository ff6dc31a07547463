"""The parts of dqn's training: one update by the head and the size of its network, and acting."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest

from benchmarks.conftest import Race
from stlbench.simulation.environment import BatchEnvironment
from stlbench.task import build_method, load_task
from stlbench_agents.dqn import DQN
from stlbench_agents.policies import Head
from stlbench_agents.q_learner import QLearner
from stlbench_agents.training import grid_of

pytestmark = pytest.mark.benchmark(timer=time.process_time, group="agent")

COPIES = 16
REPEATS = 400


@pytest.mark.parametrize("recipe", ["joint", "additive", "joint_plain"])
@pytest.mark.parametrize("width", [64, 128, 256])
def test_update(race: Race, recipe: str, width: int) -> None:
    """Microseconds of an update of batch 128, sampling included; `plain` is the paper's Algorithm 2."""
    plain: dict[str, Any] = {
        "n_steps": 1,
        "double": False,
        "averaging": 0.0,
        "tau": 1.0,
        "target_update_interval": 1000,
    }
    head: Head = "additive" if recipe == "additive" else "joint"
    agent = DQN(net_arch=(width, width), head=head, **(plain if recipe == "joint_plain" else {}))
    learner, _ = _trained(agent)
    generator = np.random.default_rng(0)

    def updates() -> None:
        for _ in range(REPEATS):
            learner.update(learner.replay.draw(generator, 1, agent.batch_size))

    times = race.run(updates, {})["ours"]
    race.note(**{f"update_{recipe}_{width}_microseconds": [each / REPEATS * 1e6 for each in times]})


@pytest.mark.parametrize("rows", [1, 16, 64])
def test_acting(race: Race, rows: int) -> None:
    """Microseconds of one choice of actions, exploration included, by hold-disc's recipe."""
    learner, observation = _trained(DQN(net_arch=(64, 64), head="additive"))
    some, generator = np.resize(observation, (rows, observation.shape[1])), np.random.default_rng(0)

    def acts() -> None:
        for _ in range(REPEATS):
            learner.act(some, 0.05, generator)

    times = race.run(acts, {})["ours"]
    race.note(**{f"act_{rows}_microseconds": [each / REPEATS * 1e6 for each in times]})


def _trained(agent: DQN) -> tuple[QLearner, Any]:
    """A learner with a thousand lock-steps of hold-disc in its replay, and an observation."""
    entry = load_task("hold-disc")
    environment = BatchEnvironment(entry, build_method(entry, "funnel"), COPIES, seed=0)
    learner = QLearner(agent, environment.observation_size, COPIES, grid_of(environment.actions), 0, 100_000)
    generator, observation = np.random.default_rng(0), environment.reset()
    for _ in range(1000):
        action = generator.integers(entry.actions.size, size=COPIES)
        came = environment.step(action)
        learner.replay.add(observation, action, came)
        observation = came.observation
    return learner, observation
