"""The formulas of a training on the track `auto`: what each rule makes of the task's formula, in turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from stlbench.contract import Array, System
from stlbench.rollout.worlds import make_world
from stlbench.schedules.derive import UnscheduledError
from stlbench.schedules.regions import Regions
from stlbench.schedules.plan import conjunction
from stlbench.schedules.schedule import Schedule, is_schedule, pursued, schedules
from stlbench.stl import Formula, fragment
from stlbench.task.derived import derived
from stlbench.task.file import TaskFile
from stlbench.task.forms import regular
from stlbench.task.task import Task

_FEW = 8
"""Copies of an environment whose first samples are looked at; of a system eight times as many."""

Relation: TypeAlias = Literal["equivalent", "stronger", "weaker"]


@dataclass(frozen=True)
class Rewrite:
    """One rule applied."""

    rule: str
    relation: Relation
    """Of the new formula to the one before: the traces that satisfy it are the same, some of these, or more."""
    formula: Formula


def schedule_of(task: Task) -> Schedule | None:
    """The schedule of a task's formula that asks for the least pace; None where the formula is a schedule already.

    Raises `UnscheduledError` where there is none, with the operator or the step and the reason.
    """
    file, regions = task.file, regions_of(task)
    if is_schedule(regular(file.formula), regions):
        return None
    return schedules(file.formula, regions, file.hold, file.steps)[0]


def regions_of(task: Task) -> Regions:
    """The distances of a task, from its ranges and its starts."""
    return Regions(task.file.box, units(task.file), initial_samples(task))


def scheduled(task: Task) -> Formula | None:
    """The formula of the schedule; None where there is none, or none is needed."""
    try:
        found = schedule_of(task)
    except UnscheduledError:
        return None
    return None if found is None else found.formula


def rewarded(formula: Formula, file: TaskFile, initial: Array) -> Formula:
    """The formula that methods are given, of a formula of the task: in regular form and on one scale."""
    if formula is file.schedule:
        formula = conjunction(pursued(fragment(formula), Regions(file.box, units(file), initial)))
    return derived(regular(formula), file.box, units(file), initial)


def units(file: TaskFile) -> dict[str, str]:
    """Signal -> its unit."""
    return {name: signal.unit for name, signal in file.signals.items()}


def initial_samples(task: Task) -> Array:
    """Signals (n, k) at the start of some episodes, always the same ones."""
    count = 8 * _FEW if isinstance(task.dynamics, System) else _FEW
    world = make_world(task, count)
    world.restart(np.arange(count), task.starts.of_training(np.random.default_rng(0), count))
    return world.signals
