"""Scores the traces of finished cells again: never call in the process in which the cell ran.

A plugin can change the referee in the process of its cell, perhaps by accident. It is not guarded against one that lies
on purpose: `docs/reference/evaluation.md`.
"""

import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Self

import numpy as np

from stlbench.contract import System
from stlbench.errors import UsageError, cause, one_line
from stlbench.records.array_files import read_cell
from stlbench.records.result import MAIN, Measurement, Result
from stlbench.records.result_files import discard_arrays
from stlbench.registry import plugins
from stlbench.simulation import referee
from stlbench.study.cell import Cell

_CLOSE = 1e-9  # a smaller difference, relative or absolute, comes from another version of a library
APART = True  # whether results of cells with plugins of others are looked at in another process
_DEADLINE = 300.0  # seconds for an answer: a task of others has to be loaded


def contradiction(cell: Cell, result: Result, folder: Path) -> str | None:
    """Where the traces of a finished cell, in the folder of results, are not scored as it says; None if they are."""
    return None if result.measurement is None else next(_of_traces(cell, result, result.measurement, folder), None)


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
            recorded, rescored = measured.selected[MAIN], referee.score(task, traces.samples)
            if recorded.satisfied != rescored.satisfied or not _close(recorded.robustness, rescored.robustness):
                numbers = f"robustness {recorded.mean:g}, satisfied {100 * recorded.satisfaction:g} %"
                now = f"{rescored.mean:g} and {100 * rescored.satisfaction:g} %"
                yield f"it says {numbers}; by the recorded traces and the formula of {task.name} it is {now}"
    except (UsageError, ValueError) as error:
        yield f"its traces cannot be scored again: {error}"


def _close(one: object, other: object) -> bool:
    a, b = np.asarray(one, dtype=np.float64), np.asarray(other, dtype=np.float64)
    return a.shape == b.shape and np.allclose(a, b, rtol=_CLOSE, atol=_CLOSE, equal_nan=True)


class ConsistencyCheck:
    """Replaces results that their traces do not score (`contradiction`) by failures, as a context manager.

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

    def __call__(self, cell: Cell, result: Result) -> Result:
        """The result, or a failure that says what its traces score; then the cell's files are removed."""
        if result.measurement is None:
            return result
        call = (cell, result, self._folder)
        problem = self._ask(call) if self._apart else contradiction(*call)
        if problem is None:
            return result
        discard_arrays(self._folder, cell.id, cell.key)
        return cell.ended("raised", f"its result is not credible: {one_line(problem)}")

    def _ask(self, call: tuple[Cell, Result, Path]) -> str | None:
        try:
            self._link = link = self._link or self._started()
            link.send(call)
            if not link.poll(_DEADLINE):
                self._open.close()  # its answer would be taken for the next one's
                self._link = None
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
        self._open.callback(process.kill)  # it may hang
        self._open.callback(ours.close)
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
