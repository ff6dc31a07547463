"""A task of two robots that fits a line of text: two points on a line, x' = x + dt v, each with its own speed."""

from __future__ import annotations

from typing import Any

import yaml

from stlbench.contract import Array, Integers, System
from stlbench.registry.choices import Choice
from stlbench.task.reading import read_task_file
from stlbench.task.task import Task


class Pair(System):
    """x' = x + dt v for both. The policy sees both over 4 m."""

    state = ("a", "b")

    def step(self, state: Array, action: Array) -> Array:
        return state + self.dt * action

    def signals(self, state: Array) -> Array:
        return state

    def features(self, state: Array, t: Integers) -> Array:
        return state / 4


FILE: dict[str, Any] = {
    "title": "Two robots on a line",
    "source": "made up",
    "formula": "G[6,8] (abs(a - 1) <= 0.6) & G[6,8] (abs(b + 1) <= 0.6)",
    "sampling_time": 0.5,
    "steps": 8,
    "signals": {"a": {"low": -4, "high": 4}, "b": {"low": -4, "high": 4}},
    "actions": {"v": {"low": -1, "high": 1, "count": 3}, "w": {"low": -2, "high": 2, "count": 5}},
    "robots": {"left": ["v"], "right": ["w"]},
    "initial": {"box": {"a": [-1, 0], "b": [0, 1]}},
    "starts": 16,
    "agents": {"dqn": {}, "dqn-per-robot": {}},
    "budgets": {"smoke": {"steps": 1600, "seeds": 1, "deadline": 60, "checkpoints": 2}},
}
"""The content of its task.yaml. In 0.5 s `left` moves by -.5, 0 or .5, `right` by -1, -.5, 0, .5 or 1."""


def pair(**changes: Any) -> Task:
    """The task, with some entries of its file replaced; None removes one."""
    content = {key: value for key, value in (FILE | changes).items() if value is not None}
    file = read_task_file(yaml.safe_dump(content, sort_keys=False), "pair")
    return Task(Choice("pair"), file, Pair(FILE["sampling_time"]))
