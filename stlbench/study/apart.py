"""A process of its own that looks at results: in the harness' own one, the plugins of the cells are imported."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from types import TracebackType
from typing import Self

from stlbench.errors import cause, one_line
from stlbench.records.beside import files_beside
from stlbench.records.result import Result
from stlbench.registry import plugins
from stlbench.study.cell import Cell
from stlbench.study.credible import contradiction

APART = True
"""Whether results of cells with plugins of others are looked at in another process."""

_DEADLINE = 300.0
"""Seconds for an answer: a task of others has to be loaded."""


class Examiner:
    """Takes the place of results that cannot be (`contradiction`), as a context manager.

    Where a cell has a method or an agent of another distribution, a fresh interpreter looks at the results. It imports
    none of them. It starts with the first result.

    Args:
        cells: of the run.
        folder: of results.
    """

    def __init__(self, cells: Iterable[Cell], folder: Path) -> None:
        self._folder, self._open = folder, ExitStack()
        self._link: Connection | None = None
        self._apart = APART and any(_is_foreign(cell) for cell in cells)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._open.close()

    def __call__(self, cell: Cell, result: Result, seconds: float) -> Result:
        """The result, or in its place a failure that says what cannot be; the files of that one are removed."""
        if result.measurement is None:
            return result
        asked = (cell, result, self._folder, seconds)
        problem = self._ask(asked) if self._apart else contradiction(*asked)
        if problem is None:
            return result
        beside = files_beside(self._folder, cell.id, cell.key)
        for file in (beside.traces, beside.policies):
            file.unlink(missing_ok=True)
        return cell.ended("raised", f"its result is not credible: {one_line(problem)}")

    def _ask(self, asked: tuple[Cell, Result, Path, float]) -> str | None:
        try:
            self._link = link = self._link or self._started()
            link.send(asked)
            if not link.poll(_DEADLINE):
                return f"who looks at it gave no answer within {_DEADLINE:.0f} s"
            answer: str | None = link.recv()
        except (EOFError, OSError) as error:
            self._link = None
            return f"who looks at it ended: {cause(error)}"
        return answer

    def _started(self) -> Connection:
        ours, theirs = Pipe()
        code = f"from stlbench.study.apart import serve; serve({theirs.fileno()})"
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
    found = (plugins.available(kind).get(name) for kind, name in named)
    return any(plugin is not None and plugin.distribution != plugins.OWN for plugin in found)


def serve(descriptor: int) -> None:
    """Answer what comes from the harness, until it has gone."""
    link = Connection(descriptor)
    with suppress(EOFError, OSError):
        sys.path[:] = link.recv()
        while True:
            asked = link.recv()
            try:
                answer = contradiction(*asked)
            except Exception as error:
                answer = f"it cannot be looked at: {cause(error)}"
            link.send(answer)
