"""Steps of an environment a second: in lock-step as training has them, and one at a time through Gymnasium."""

from __future__ import annotations

import time

import gymnasium
import numpy as np
import pytest

import stlbench.gym  # noqa: F401 - registers the tasks
from benchmarks.conftest import Race
from stlbench.simulation.environment import BatchEnvironment
from stlbench.task import build_method, load_task

pytestmark = pytest.mark.benchmark(timer=time.process_time, group="environment")

TASKS = ("hold-disc", "robot-nav")


@pytest.mark.parametrize("copies", [16, 1024])
@pytest.mark.parametrize("task", TASKS)
def test_in_lock_step(race: Race, task: str, copies: int) -> None:
    """Steps of one sampling time per second, all copies together, with the funnel's reward."""
    entry = load_task(task)
    environment = BatchEnvironment(entry, build_method(entry, "funnel"), copies, seed=0)
    actions = np.random.default_rng(0).integers(entry.actions.size, size=(200, copies))

    def steps() -> None:
        for action in actions:
            environment.step(action)

    times = race.run(steps, {})["ours"]
    taken = len(actions) * copies * entry.file.hold
    race.note(**{f"environment_{_key(task)}_{copies}_steps_per_second": [taken / each for each in times]})


@pytest.mark.parametrize("task", TASKS)
def test_gymnasium(race: Race, task: str) -> None:
    """The same for `gymnasium.make`, one copy."""
    environment = gymnasium.make(f"stlbench/{task}-v0", method="funnel").unwrapped
    entry = load_task(task)
    actions = np.random.default_rng(0).integers(entry.actions.size, size=1000)
    environment.reset(seed=0)

    def steps() -> None:
        for action in actions:
            if environment.step(action)[3]:
                environment.reset()

    times = race.run(steps, {})["ours"]
    taken = len(actions) * entry.file.hold
    race.note(**{f"environment_{_key(task)}_gymnasium_steps_per_second": [taken / each for each in times]})


def _key(name: str) -> str:
    return name.replace("-", "_")
