"""A task that fits a line of text: a point on a line, x' = x + dt v, so that every trace can be worked out by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import yaml

from helpers.stepwise import Stepwise
from stlbench.contract import Array, Integers, Policy, System
from stlbench.registry.choices import Choice
from stlbench.task.reading import read_task_file
from stlbench.task.task import Task


class Line(System):
    """x' = x + dt v. The policy sees x and, so that rows can be told apart, the step count."""

    state = ("x",)

    def step(self, state: Array, action: Array) -> Array:
        return state + self.dt * action

    def signals(self, state: Array) -> Array:
        return state

    def features(self, state: Array, t: Integers) -> Array:
        return np.stack([state[:, 0], t.astype(float)], axis=1)


SYSTEM = """
from stlbench.contract import System
class Line(System):
    state = ("x",)
    def step(self, state, action): return state + self.dt * action
    def signals(self, state): return state
    def features(self, state, t): return state
"""
"""The source of such a system, for distributions that tests write; its policy sees x alone."""

FILE: dict[str, Any] = {
    "title": "A line",
    "source": "made up",
    "formula": "G[0,4] (x <= 1)",
    "sampling_time": 0.5,
    "steps": 8,
    "signals": {"x": {"low": -10, "high": 10, "unit": "m"}},
    "actions": {"v": {"low": -1, "high": 1, "count": 3, "unit": "m/s"}},
    "initial": {"box": {"x": [-1, 1]}},
    "starts": 4,
    "agents": {"dqn": {}},
    "budgets": {"smoke": {"steps": 40, "seeds": 1, "deadline": 60, "checkpoints": 2}},
}
"""The content of its task.yaml. With v in -1, 0, 1 m/s for 0.5 s, x moves by -.5, 0 or .5 a step."""


REACH: dict[str, Any] = {
    "formula": "G[9,12] (abs(x - 1) <= 0.4)",
    "steps": 12,
    "initial": {"box": {"x": [-3, 3]}},
    "starts": 32,
    "actions": {"v": {"low": -1, "high": 1}},
}
"""Changes: from [-3, 3] to within 0.4 of 1 after 8 of 12 steps of at most 0.5."""


def text(**changes: Any) -> str:
    """The task file with some entries replaced; None removes one."""
    return yaml.safe_dump({key: value for key, value in (FILE | changes).items() if value is not None}, sort_keys=False)


def line(**changes: Any) -> Task:
    """The task, with some entries of its file replaced."""
    return Task(Choice("line"), read_task_file(text(**changes), "line"), Line(FILE["sampling_time"]))


def steered(control: Callable[[Array, Integers], Any], **changes: Any) -> Task:
    """The task with a controller."""

    class Steered(Line):
        def controller(self, state: Array, t: Integers) -> Array:
            found: Array = control(state, t)
            return found

    task = line(**changes)
    return replace(task, dynamics=Steered(task.system.dt))


class Probe(Stepwise):
    """Reward 100 t + 10 x_{t+1} + x_t: which transition it was, and where it led. With or without a memory."""

    scale = 1.0
    floor = -0.5

    def __init__(self, specification: Any, memory_size: int = 0) -> None:
        super().__init__(specification)
        self.memory_size = memory_size

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        """The first column counts transitions; the others hold s_0."""
        memory = np.tile(signals[:, :1], self.memory_size)
        memory[:, :1] = 0
        return memory

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        after = memory.copy()
        after[:, :1] += 1
        return 100.0 * t + 10 * next_signals[:, 0] + signals[:, 0], after


class Rule(Policy):
    """A policy that is a function of what it observes."""

    def __init__(self, rule: Callable[[Array], Any]) -> None:
        self.rule = rule

    def act(self, observation: Array) -> Integers:
        return np.broadcast_to(np.asarray(self.rule(observation), dtype=np.int64), (len(observation),))
