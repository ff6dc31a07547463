"""What a task shows to policies: how many numbers, and what they mean."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stlbench.contract import GymTask, RewardMethod, System
from stlbench.records.observation import Observation
from stlbench.rollout.worlds import make_world
from stlbench.task.task import Task


def observation_of(task: Task, method: RewardMethod, name: str = "") -> Observation:
    """What policies see of a task, with the inputs of a method; `name` is what users call the method."""
    beside = Observation.beside(task.file.steps, method.input_size, name, task.name)
    if isinstance(task.dynamics, GymTask):
        return task.source.observed.described(beside)
    names: tuple[str, ...] = ()
    if isinstance(task.dynamics, System):
        more = task.dynamics.beyond_state if task.file.features == "engineered" else ()
        names = (*task.dynamics.state, *more)
    return replace(beside, size=size_without(task) - 1, names=names)


def observation_size(task: Task, method: RewardMethod) -> int:
    """D: features, the time, and the method's inputs."""
    return size_without(task) + method.input_size


def size_without(task: Task) -> int:
    """Features and the time. No environment is made, as some methods import a compiler for their first memory."""
    world = make_world(task, 1)
    world.restart(np.zeros(1, dtype=np.int64), task.starts.report_and_selection()[0][:1])
    features: int = world.features(np.zeros(1, dtype=np.int64)).shape[1]
    return features + 1
