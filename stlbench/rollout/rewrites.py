"""The formulas of a training on the track `auto`: what each rule makes of the task's formula, in turn."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, TypeAlias

import numpy as np

from stlbench.contract import Array, System
from stlbench.rollout.worlds import make_world
from stlbench.schedules.derive import UnscheduledError
from stlbench.schedules.plan import conjunction
from stlbench.schedules.regions import Regions
from stlbench.schedules.schedule import Schedule, is_schedule, pursued, schedules
from stlbench.stl import Formula, fragment
from stlbench.task.derived import derived
from stlbench.task.file import TaskFile
from stlbench.task.forms import regular
from stlbench.task.task import Task

_FEW = 8
"""Copies of an environment whose first samples are looked at; of a system eight times as many."""

Relation: TypeAlias = Literal["equivalent", "stronger", "weaker"]
"""Of a new formula to the one before. It is satisfied by the same traces; by some of these alone; by these and perhaps
by others."""


@dataclass(frozen=True)
class Rewrite:
    """One rule applied."""

    rule: str
    relation: Relation
    formula: Formula


def alternatives(task: Task) -> tuple[Schedule, ...]:
    """The schedules of a task's formula, the best first; none where the formula is a schedule already.

    Raises `UnscheduledError` where there is none, with the operator or the step and the reason.
    """
    file = task.file
    return _alternatives(file.formula, regions(task), file.hold, file.steps)


def regions(task: Task) -> Regions:
    """Distances between conditions on a task, and from its starts."""
    return _regions_of(task.file, initial_samples(task))


@lru_cache(maxsize=256)
def _alternatives(formula: Formula, regions: Regions, hold: int, steps: int) -> tuple[Schedule, ...]:
    """Kept, since a run asks for each task once for each of its methods and seeds."""
    if is_schedule(regular(formula), regions):
        return ()
    return tuple(schedules(formula, regions, hold, steps))


def _regions_of(file: TaskFile, initial: Array) -> Regions:
    """The regions of a task, always the same object for the same ranges and starts."""
    rows = np.asarray(initial, dtype=np.float64).tolist()
    return _regions(tuple(file.box.items()), tuple(units(file).items()), tuple(map(tuple, rows)))


@lru_cache(maxsize=256)
def _regions(
    box: tuple[tuple[str, tuple[float, float]], ...],
    unit: tuple[tuple[str, str], ...],
    initial: tuple[tuple[float, ...], ...],
) -> Regions:
    """Kept, since its points and distances are found once."""
    return Regions(dict(box), dict(unit), np.array(initial))


def scheduled(task: Task) -> Formula | None:
    """The formula of the schedule; None where there is none, or none is needed."""
    try:
        found = alternatives(task)
    except UnscheduledError:
        return None
    return found[0].formula if found else None


def rewrites(file: TaskFile, initial: Array) -> tuple[Rewrite, ...]:
    """The formulas from the task's own to the one that methods are given; rules that change nothing are left out.

    Args:
        file: of a task, with its schedule where it has one.
        initial: samples (n, k) at the start of episodes.
    """
    found = [Rewrite("task", "equivalent", file.formula)]

    def add(rule: str, relation: Relation, formula: Formula) -> None:
        if formula != found[-1].formula:
            found.append(Rewrite(rule, relation, formula))

    if file.schedule is not None:
        add("schedule", "stronger", file.schedule)
        earlier = pursued(fragment(file.schedule), _regions_of(file, initial))
        add("begins", "weaker", conjunction(earlier))
    add("form", "weaker", regular(found[-1].formula))
    add("scale", "equivalent", derived(found[-1].formula, file.box, units(file), initial, file.hold))
    return tuple(found)


def units(file: TaskFile) -> dict[str, str]:
    """Signal -> its unit."""
    return {name: signal.unit for name, signal in file.signals.items()}


def initial_samples(task: Task) -> Array:
    """Signals (n, k) at the start of some episodes, always the same ones."""
    count = 8 * _FEW if isinstance(task.dynamics, System) else _FEW
    world = make_world(task, count)
    world.restart(np.arange(count), task.starts.of_training(np.random.default_rng(0), count))
    return world.signals
