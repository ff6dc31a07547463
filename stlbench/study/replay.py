"""What a stored policy does from any start, simulated again."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stlbench.contract import Array, GymTask, RewardMethod
from stlbench.errors import UsageError
from stlbench.records.result import Result
from stlbench.records.saved_policies import Which
from stlbench.records.saved_traces import Film
from stlbench.rollout import referee
from stlbench.rollout.reenactment import Reenactment
from stlbench.rollout.traces import Recording
from stlbench.study.kept import load_policy
from stlbench.task import Task
from stlbench.task.start_sets import StateStarts


@dataclass(frozen=True)
class Start:
    """Which one: of the report's, or anywhere. All of the report's where neither is said."""

    index: int | None = None
    """Of the report's grid, counted from 0."""
    point: tuple[float, ...] | None = None
    """In the coordinates of the task's `initial` box; of an environment whose starts are seeds, one of them."""


EVERY = Start()
"""All starts of the report's grid."""


class Replay(NamedTuple):
    """Traces of a policy, and what the referee says of them."""

    task: Task
    method: RewardMethod | None
    """None where traces were recorded, and nothing acted again."""
    recording: Recording
    robustness: tuple[float, ...]
    """From each start."""


def parse_start(text: str) -> tuple[float, ...]:
    """The numbers of "0.3,1.2". Raises `UsageError` where one is none."""
    try:
        point = tuple(float(part) for part in text.split(","))
    except ValueError:
        point = ()
    if not point or not all(map(math.isfinite, point)):
        raise UsageError(f"--start {text}: numbers separated by commas are expected, as in 0.3,1.2")
    return point


def replay(folder: Path, result: Result, which: Which = "selected", start: Start = EVERY) -> Replay:
    """Let a cell's stored policy act again.

    Raises:
        UsageError: no policy of the cell can be used (`load_policy`), or the task has no such start.
    """
    task, method, policy = load_policy(folder, result, which)
    visited = list[Array]()
    traces = referee.record(task, method, policy, _begun(task, start), visited).traces
    robustness = referee.score(task, traces).robustness
    extremes = np.array([np.argmax(robustness), np.argmin(robustness)])[: len(traces)]
    states = np.stack(visited, axis=1)
    return Replay(task, method, Recording(traces, 1, Film(extremes, states[extremes])), robustness)


def reenact(folder: Path, result: Result, which: Which, start: Start, film: Film) -> Reenactment:
    """Let a cell's stored policy act before a camera, from the starts of a film.

    Raises:
        UsageError: as `replay`, or the task's environment has no pictures.
    """
    task, method, policy = load_policy(folder, result, which)
    if isinstance(task.dynamics, GymTask) and task.source.undrawn:
        raise UsageError(task.source.undrawn)
    return Reenactment(task, method, policy, _begun(task, start)[film.starts])


def _begun(task: Task, start: Start) -> Array:
    """The starts (N, s)."""
    if start.point is not None:
        return _at(task, start.point)
    reported = task.starts.report_and_selection()[0]
    if start.index is None:
        return reported
    if start.index >= len(reported):
        raise UsageError(f"the report of {task.name} has starts 0 to {len(reported) - 1}, got {start.index}")
    return reported[[start.index]]


def _at(task: Task, point: tuple[float, ...]) -> Array:
    """One start, (1, s)."""
    starts = task.starts
    if not isinstance(starts, StateStarts):
        if len(point) != 1 or point[0] < 0 or point[0] != int(point[0]):
            raise UsageError(f"a start of {task.name} is a seed, a whole number from 0 on")
        return np.array([point])
    names = tuple(starts.initial.box)
    if len(point) != len(names):
        raise UsageError(f"a start of {task.name} has {len(names)} numbers, {', '.join(names)}; got {len(point)}")
    return starts.system.initial_states(np.array([point]))
