"""Steps of Gymnasium's MuJoCo robots: copies in the harness beside as many in Gymnasium's own vector environment."""

from __future__ import annotations

import time

import gymnasium
import numpy as np
import pytest

from benchmarks.conftest import Race, ratios, without
from stlbench.contract import GymTask
from stlbench.registry.choices import Choice
from stlbench.simulation.worlds import make_world
from stlbench.task.file import TaskFile
from stlbench.task.task import Task

pytestmark = pytest.mark.benchmark(timer=time.process_time, group="robots")

COPIES, STEPS = 64, 20


def robot(name: str) -> Task:
    file = {
        **{"title": name, "source": name, "formula": "F[0,100] (x >= 1)", "sampling_time": 0.05, "steps": 100},
        **{"environment": {"id": name}, "agents": {"td3": {}}, "budgets": {"quick": {"steps": 1000}}},
        "signals": {"x": {"low": -10, "high": 10, "expression": "x_position"}},
    }
    return Task(Choice(name.lower()), TaskFile.model_validate(file), GymTask())


@pytest.mark.parametrize("name", ["Ant-v5", "HalfCheetah-v5", "Hopper-v5", "Walker2d-v5"])
def test_steps(race: Race, name: str) -> None:
    """CPU seconds of resets and steps; above 1 the harness takes less. No copy ends within the steps."""
    if missing := without(["mujoco"]):
        pytest.skip(missing["mujoco"])
    own, copies = gymnasium.make_vec(name, num_envs=COPIES, vectorization_mode="sync"), make_world(robot(name), COPIES)
    space = own.single_action_space
    assert isinstance(space, gymnasium.spaces.Box)
    actions = 0.1 * np.random.default_rng(0).uniform(space.low, space.high, (STEPS, COPIES, *space.shape))

    def ours() -> None:
        copies.restart(np.arange(COPIES), np.arange(COPIES, dtype=float)[:, None])
        for action in actions:
            copies.advance(action, 1)
        assert not copies.ended.any()

    def theirs() -> None:
        own.reset(seed=0)
        for action in actions.astype(np.float32):
            own.step(action)

    times = race.run(ours, {"gymnasium": theirs})
    key = f"robot_{name.partition('-')[0].lower()}"
    race.note(**{f"{key}_vs_gymnasium": ratios(times["gymnasium"], times["ours"])})
    race.note(**{f"{key}_steps_per_second": [COPIES * STEPS / each for each in times["ours"]]})
