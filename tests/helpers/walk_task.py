"""A task on `walk_env.Walk`, an environment of Gymnasium without a state that could be set, for tests by hand."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import gymnasium
import yaml

from helpers.walk_env import Walk
from stlbench.contract import GymTask
from stlbench.registry.choices import Choice
from stlbench.task.reading import read_task_file
from stlbench.task.task import Task


class WalkTask(GymTask):
    """Its controller by hand steps left where x is positive and right where it is not."""

    def __init__(self, **keywords: Any) -> None:
        self._keywords = keywords

    def make(self) -> gymnasium.Env[Any, Any]:
        return Walk(**self._keywords)

    def controller(self, observation: Any, info: Mapping[str, Any], t: int) -> Sequence[float]:
        return [0.0 if info["doubled"] > 0 else 2.0]


class Made(GymTask):
    """Its environments are those that a function makes."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self._make = make

    def make(self) -> gymnasium.Env[Any, Any]:
        return self._make()


FILE: dict[str, Any] = {
    "title": "A walk",
    "source": "made up",
    "formula": "G[0,4] (x <= 1)",
    "sampling_time": 0.5,
    "steps": 8,
    "environment": {"names": ["x", "minus"]},
    "signals": {"x": {"low": -10, "high": 10, "unit": "m"}},
    "starts": 4,
    "agents": {"dqn": {}},
    "budgets": {"smoke": {"steps": 40, "seeds": 1, "deadline": 60, "checkpoints": 2, "random_starts": 5}},
}
"""The content of its task.yaml. Action 0, 1 or 2 moves x by -.5, 0 or .5."""


def walk_text(**changes: Any) -> str:
    """The task file with some entries replaced; None removes one."""
    return yaml.safe_dump({key: value for key, value in (FILE | changes).items() if value is not None}, sort_keys=False)


def walk(kind: GymTask | None = None, **changes: Any) -> Task:
    """The task, with some entries of its file replaced."""
    return Task(Choice("walk"), read_task_file(walk_text(**changes), "walk"), kind or WalkTask())
