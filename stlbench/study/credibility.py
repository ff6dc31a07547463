"""Whether a finished cell's result can be: never call in the process in which the cell ran.

A plugin can change anything in the process of its cell: the referee, the clock, the files. So what that process says of
its policies is compared with itself, with the recorded traces, and with how long the cell was away. What a plugin could
still do is in `docs/reference/evaluation.md`.
"""

from __future__ import annotations

import math
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from itertools import chain
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Self

import numpy as np

from stlbench.contract import System
from stlbench.errors import UsageError, cause, one_line
from stlbench.records.outputs import cell_files
from stlbench.records.result import MAIN, Measurement, Result, Score, from_json, to_json
from stlbench.records.saved_traces import read_cell
from stlbench.registry import plugins
from stlbench.rollout import referee
from stlbench.study.cell import Cell
from stlbench.task import Task

_CLOSE = 1e-9  # a smaller difference, relative or absolute, comes from another version of a library
APART = True  # whether results of cells with plugins of others are looked at in another process
_DEADLINE = 300.0  # seconds for an answer: a task of others has to be loaded


def contradiction(cell: Cell, result: Result, folder: Path, seconds: float = math.inf) -> str | None:
    """What cannot be true of a finished cell's result, in a line; None if nothing contradicts it.

    The cell took `seconds` of wall time at most; its traces lie in the folder of results.
    """
    if result.measurement is None:
        return None
    numbers = chain(_of_scores(result.measurement), _of_clocks(result.measurement, seconds), _of_row(result))
    return next(chain(numbers, _of_traces(cell, result, result.measurement, folder)), None)


def _of_row(result: Result) -> Iterator[str]:
    """What is recorded can be read again."""
    try:
        from_json(to_json(result))
    except ValueError as error:
        yield f"its row cannot be read again: {error}"


def _of_scores(measured: Measurement) -> Iterator[str]:
    for which, scores in (("selected", measured.selected), ("final", measured.final)):
        for protocol, score in scores.items():
            for problem in _impossible(score):
                yield f"the {which} policy's score by the protocol {protocol} cannot be: {problem}"


def _impossible(score: Score) -> Iterator[str]:
    """A formula that is satisfied has a robustness of at least 0, and one that is violated at most 0."""
    of_starts = zip(score.robustness, score.satisfied, strict=False)  # `_of_row` says where one has more
    for start, (robustness, satisfied) in enumerate(of_starts):
        if (robustness < 0 and satisfied) or (robustness > 0 and not satisfied):
            yield f"robustness {robustness:g} from start {start}, which is {'' if satisfied else 'not '}satisfied"
    if (summary := score.summary) is None:
        return
    if not 0 <= summary.satisfaction <= 1 or summary.mean < summary.minimum:
        yield f"satisfaction {summary.satisfaction:g}, mean robustness {summary.mean:g}, the least {summary.minimum:g}"
    if summary.satisfaction < 1 and summary.minimum > 0:
        yield f"the least robustness is {summary.minimum:g} beside {100 * summary.satisfaction:g} % satisfied"
    if summary.satisfaction == 1 and summary.minimum < 0:
        yield f"the least robustness is {summary.minimum:g} beside 100 % satisfied"
    if summary.satisfaction == 0 and summary.mean > 0:
        yield f"the mean robustness is {summary.mean:g} beside 0 % satisfied"


def _of_clocks(measured: Measurement, seconds: float) -> Iterator[str]:
    """Training is a part of the cell, and the harness has measured the cell's wall time."""
    parts = (
        (measured.training_cpu_seconds, measured.cpu_seconds),
        (measured.training_wall_seconds, measured.wall_seconds),
    )
    if not all(0 <= part <= whole + 1e-3 < math.inf for part, whole in parts):
        yield f"its clocks cannot be right: training and all took {parts[0]} s of CPU, {parts[1]} s of time"
    if measured.wall_seconds > seconds + 1:
        yield f"its clock cannot be right: it says {measured.wall_seconds:.3g} s, and was away for {seconds:.3g} s"


def _of_traces(cell: Cell, result: Result, measured: Measurement, folder: Path) -> Iterator[str]:
    """The main score is that of the recorded traces, which begin where the report's starts are."""
    try:
        task = cell.load_task()
        traces, begun = read_cell(folder, result), task.starts.report_and_selection()[0]
        expected = len(begun), task.file.steps + 1, len(task.signals)
        if traces.names != task.signals or traces.samples.shape != expected:
            yield f"its traces have shape {traces.samples.shape}, the task's have {expected}"
        elif isinstance(task.dynamics, System) and not _close(traces.samples[:, 0], task.system.signals(begun)):
            yield "its traces do not begin at the report's starts"
        else:
            yield from _other_score(task, measured.selected[MAIN], referee.score(task, traces.samples))
    except (UsageError, ValueError) as error:
        yield f"its traces cannot be scored again: {error}"


def _other_score(task: Task, recorded: Score, rescored: Score) -> Iterator[str]:
    if recorded.satisfied != rescored.satisfied or not _close(recorded.robustness, rescored.robustness):
        numbers = f"robustness {recorded.mean:g}, satisfied {100 * recorded.satisfaction:g} %"
        now = f"{rescored.mean:g} and {100 * rescored.satisfaction:g} %"
        yield f"it says {numbers}; by the recorded traces and the formula of {task.name} it is {now}"


def _close(one: object, other: object) -> bool:
    a, b = np.asarray(one, dtype=np.float64), np.asarray(other, dtype=np.float64)
    return a.shape == b.shape and np.allclose(a, b, rtol=_CLOSE, atol=_CLOSE, equal_nan=True)


class Examiner:
    """Replaces results that cannot be true (`contradiction`) by failures, as a context manager.

    If a cell has a method or an agent of another distribution, a fresh interpreter examines the results. It imports
    none of them, and starts with the first result.
    """

    def __init__(self, cells: Iterable[Cell], folder: Path) -> None:
        self._folder, self._open = folder, ExitStack()
        self._link: Connection | None = None
        self._apart = APART and any(_is_foreign(cell) for cell in cells)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._open.close()

    def __call__(self, cell: Cell, result: Result, seconds: float) -> Result:
        """The result, or a failure that says why it is impossible; then the cell's files are removed."""
        if result.measurement is None:
            return result
        call = (cell, result, self._folder, seconds)
        problem = self._ask(call) if self._apart else contradiction(*call)
        if problem is None:
            return result
        files = cell_files(self._folder, cell.id, cell.key)
        for file in (files.traces, files.policies):
            file.unlink(missing_ok=True)
        return cell.ended("raised", f"its result is not credible: {one_line(problem)}")

    def _ask(self, call: tuple[Cell, Result, Path, float]) -> str | None:
        try:
            self._link = link = self._link or self._started()
            link.send(call)
            if not link.poll(_DEADLINE):
                return f"who looks at it gave no answer within {_DEADLINE:.0f} s"
            answer: str | None = link.recv()
        except (EOFError, OSError) as error:
            self._link = None
            return f"who looks at it ended: {cause(error)}"
        return answer

    def _started(self) -> Connection:
        ours, theirs = Pipe()
        code = f"from stlbench.study.credibility import serve; serve({theirs.fileno()})"
        process = subprocess.Popen(  # noqa: S603 - our own interpreter and code
            [sys.executable, "-c", code],
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # a ctrl-C in the terminal is for the harness
        )
        theirs.close()
        self._open.callback(process.wait)
        self._open.callback(ours.close)  # the process ends when it has nobody to answer
        ours.send(sys.path)
        return ours


def _is_foreign(cell: Cell) -> bool:
    named = (("methods", cell.id.method.name), ("agents", cell.id.agent.name))
    installed = (plugins.available(kind).get(name) for kind, name in named)
    return any(plugin is not None and not plugin.is_own for plugin in installed)


def serve(descriptor: int) -> None:
    """Answer the harness until it has gone."""
    link = Connection(descriptor)
    with suppress(EOFError, OSError):
        sys.path[:] = link.recv()
        while True:
            call = link.recv()
            try:
                answer = contradiction(*call)
            except Exception as error:
                answer = f"it cannot be looked at: {cause(error)}"
            link.send(answer)
