"""The tasks that agents are checked on: a point on a line, or two robots, with a reward."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stlbench.contract import Array, Integers, RewardMethod, Specification, System
from stlbench.registry.choices import Choice
from stlbench.task import Task
from stlbench.task.reading import read_task_file

_TEXT = """
title: Go to the middle and stay there
source: made for checks of agents
formula: G[5,10] ({distance} <= 0.2)
sampling_time: 0.1
steps: 10
signals: {signals}
actions: {actions}
robots: {robots}
initial: {{box: {box}}}
starts: 8
agents: {{check: {{}}}}
budgets: {{check: {{steps: {steps}, checkpoints: 3}}}}
"""
_STEPS = 2000


@dataclass(frozen=True)
class Form:
    """The points and actions of a task."""

    text: str  # for messages
    points: tuple[str, ...] = ("x",)
    count: int | None = None  # values of each action; None if it is continuous
    robots: bool = False  # whether each point is a robot of its own


FORMS = (
    Form("one of 5 actions", count=5),
    Form("continuous actions"),
    Form("two robots with 3 actions each", ("x", "y"), 3, robots=True),
)
"""An agent has to train on one of these; it may refuse the others."""


class _Line(System):
    """x' = x + dt v, for each point."""

    def __init__(self, dt: float, points: tuple[str, ...]) -> None:
        super().__init__(dt)
        self.state = points  # type: ignore[misc]  # a class of its own for each number of points would say no more

    def step(self, state: Array, action: Array) -> Array:
        return state + self.dt * action

    def signals(self, state: Array) -> Array:
        return state

    def features(self, state: Array, t: Integers) -> Array:
        return state / 2


class Nearness(RewardMethod):
    """How near the middle the points are, in [-1, 0]."""

    def __init__(self, specification: Specification) -> None:
        super().__init__(specification)

    def arrival(self, signals: Array, t: Integers) -> Array:
        """Minus the mean distance, over 2."""
        nearness: Array = -np.abs(signals).mean(axis=-1) / 2
        return np.clip(nearness, -1, 0)


def line_task(form: Form) -> Task:
    """The task: 10 steps of 0.1 s, starts in [-1, 1], speeds in [-2, 2]."""
    axes = {name: f"v{name}" for name in form.points}
    count = f", count: {form.count}" if form.count else ""
    text = _TEXT.format(
        distance=f"norm({', '.join(form.points)})" if len(form.points) > 1 else f"abs({form.points[0]})",
        signals=_flow({name: "{low: -2, high: 2}" for name in form.points}),
        actions=_flow({axis: f"{{low: -2, high: 2{count}}}" for axis in axes.values()}),
        robots=_flow({name: f"[{axis}]" for name, axis in axes.items()} if form.robots else {}),
        box=_flow({name: "[-1, 1]" for name in form.points}),
        steps=_STEPS,
    )
    return Task(Choice("line"), read_task_file(text, "line"), _Line(0.1, form.points))


def _flow(entries: dict[str, str]) -> str:
    return f"{{{', '.join(f'{name}: {value}' for name, value in entries.items())}}}"
