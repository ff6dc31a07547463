"""Whether a finished cell's result can be: never asked in the process in which the cell ran.

A plugin can change anything in the process of its cell: the referee, the clock, the files. So what that process says of
its policies is compared with itself, with the recorded traces, and with how long the cell was away. What a plugin could
still do is in `docs/reference/evaluation.md`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from stlbench.contract import System
from stlbench.errors import UsageError
from stlbench.records.result import MAIN, Measurement, Result, Score
from stlbench.records.saved_traces import read_cell
from stlbench.registry import folders
from stlbench.rollout import referee
from stlbench.study.cell import Cell
from stlbench.study.tracks import on_track
from stlbench.task import Task, load_task

_CLOSE = 1e-9
"""Relative and absolute difference that is none: of the sums of several versions of a library."""


def contradiction(cell: Cell, result: Result, folder: Path, seconds: float = math.inf) -> str | None:
    """What cannot be of a finished cell's result, in a line; None where there is nothing, or no measurement.

    Args:
        cell: as it was planned.
        result: what the cell's process gave.
        folder: of results, with the cell's traces.
        seconds: of wall time that the cell took at most.
    """
    if result.measurement is None:
        return None
    of_traces = _of_traces(cell, result, result.measurement.selected[MAIN], folder)
    return next(chain(_of_scores(result.measurement), _of_clocks(result.measurement, seconds), of_traces), None)


def _of_scores(measured: Measurement) -> Iterator[str]:
    for which, scores in (("selected", measured.selected), ("final", measured.final)):
        for protocol, score in scores.items():
            for problem in _impossible(score):
                yield f"the {which} policy's score by the protocol {protocol} cannot be: {problem}"


def _impossible(score: Score) -> Iterator[str]:
    """By soundness: what is satisfied has a robustness of at least 0, what is not has one of at most 0."""
    of_starts = zip(score.robustness, score.satisfied, strict=True)
    for start, (robustness, satisfied) in enumerate(of_starts):
        if (robustness < 0 and satisfied) or (robustness > 0 and not satisfied):
            yield f"robustness {robustness:g} from start {start}, which is {'' if satisfied else 'not '}satisfied"
    if (kept := score.summary) is None:
        return
    if not 0 <= kept.satisfaction <= 1 or kept.mean < kept.minimum:
        yield f"satisfaction {kept.satisfaction:g}, mean robustness {kept.mean:g}, the least {kept.minimum:g}"
    if kept.satisfaction < 1 and kept.minimum > 0:
        yield f"the least robustness is {kept.minimum:g} beside {100 * kept.satisfaction:g} % satisfied"
    if kept.satisfaction == 1 and kept.minimum < 0:
        yield f"the least robustness is {kept.minimum:g} beside 100 % satisfied"
    if kept.satisfaction == 0 and kept.mean > 0:
        yield f"the mean robustness is {kept.mean:g} beside 0 % satisfied"


def _of_clocks(measured: Measurement, seconds: float) -> Iterator[str]:
    """Training is a part of the cell, whose wall time the harness has seen; some rounding aside."""
    parts = (
        (measured.training_cpu_seconds, measured.cpu_seconds),
        (measured.training_wall_seconds, measured.wall_seconds),
    )
    if not all(0 <= part <= whole + 1e-3 < math.inf for part, whole in parts):
        yield f"its clocks cannot be right: training and all took {parts[0]} s of CPU, {parts[1]} s of time"
    if measured.wall_seconds > seconds + 1:
        yield f"its clock cannot be right: it says {measured.wall_seconds:.3g} s, and was away for {seconds:.3g} s"


def _of_traces(cell: Cell, result: Result, said: Score, folder: Path) -> Iterator[str]:
    """The main score is that of the recorded traces, which begin where the report's starts are."""
    if cell.folder is not None:
        folders.know(cell.folder)  # this process may be another than the one in which it was named
    try:
        task = on_track(load_task(cell.id.task), cell.id.agent, cell.id.track, cell.recipe)
        traces, begun = read_cell(folder, result), task.starts.report_and_selection()[0]
        expected = len(begun), task.file.steps + 1, len(task.signals)
        if traces.names != task.signals or traces.samples.shape != expected:
            yield f"its traces have shape {traces.samples.shape}, the task's have {expected}"
        elif isinstance(task.dynamics, System) and not _close(traces.samples[:, 0], task.system.signals(begun)):
            yield "its traces do not begin at the report's starts"
        else:
            yield from _other_score(task, said, referee.score(task, traces.samples))
    except (UsageError, ValueError) as error:
        yield f"its traces cannot be scored again: {error}"


def _other_score(task: Task, said: Score, found: Score) -> Iterator[str]:
    if said.satisfied != found.satisfied or not _close(said.robustness, found.robustness):
        numbers = f"robustness {said.mean:g}, satisfied {100 * said.satisfaction:g} %"
        again = f"{found.mean:g} and {100 * found.satisfaction:g} %"
        yield f"it says {numbers}; by the recorded traces and the formula of {task.name} it is {again}"


def _close(one: object, other: object) -> bool:
    a, b = np.asarray(one, dtype=np.float64), np.asarray(other, dtype=np.float64)
    return a.shape == b.shape and np.allclose(a, b, rtol=_CLOSE, atol=_CLOSE, equal_nan=True)
