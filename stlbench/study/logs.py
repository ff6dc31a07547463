"""Who hears how a study goes on: its caller, and logs. Each log is told in a thread of its own, and one that raises or
hangs is turned off.
"""

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from itertools import chain
from pathlib import Path
from queue import SimpleQueue
from typing import Protocol, Self, runtime_checkable

from stlbench.contract import LoggedCell, LoggedCheckpoint, RunLog, cause
from stlbench.errors import UsageError, one_line
from stlbench.records.identity import CellId
from stlbench.records.result import SCHEMA, Result
from stlbench.records.result_files import inside
from stlbench.registry import plugins
from stlbench.registry.choices import Choice

_MOST_SECONDS = 30.0  # that one call of a log may take
_END_SECONDS = 60.0  # that logs may take after the end of a run


def build_logs(choices: Iterable[Choice]) -> dict[str, RunLog]:
    """The logs by name. Raises `UsageError` where one cannot be made."""
    logs = dict[str, RunLog]()
    for choice in choices:
        with plugins.guarded(f"log '{choice}'"):
            logs[str(choice)] = plugins.build("logs", choice)
    return logs


def logged(result: Result) -> LoggedCell:
    measured, name = result.measurement, result.id.name
    if measured is None:
        return LoggedCell(name, result.id.budget, result.status, result.reason)
    values = {datum.log: datum.of(measured) for datum in SCHEMA.values() if datum.log}
    numbers = {name: float(value) for name, value in values.items() if value is not None}
    curve = [LoggedCheckpoint(name, at.steps, at.satisfaction, at.robustness_mean) for at in measured.curve]
    return LoggedCell(name, result.id.budget, result.status, "", numbers, tuple(curve))


@runtime_checkable
class Listener(Protocol):
    """Hears how a study goes on."""

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        """These cells are going to run; `done` others have a result from before."""

    def note(self, text: str) -> None:
        """Something that the user should know of the study, in a line."""

    def ended(self, result: Result) -> None:
        """One more cell has ended."""


class Silent:
    """Hears nothing."""

    def begin(self, missing: Sequence[CellId], done: int) -> None: ...

    def note(self, text: str) -> None: ...

    def ended(self, result: Result) -> None: ...


Callback = Callable[[int, int, Result], object]
"""Is called as each cell ends: how many have a result, of how many, and the last one."""


class _Calling(Silent):
    def __init__(self, callback: Callback) -> None:
        self._callback, self._done, self._total = callback, 0, 0

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        self._done, self._total = done, done + len(missing)

    def ended(self, result: Result) -> None:
        self._done += 1
        self._callback(self._done, self._total, result)


@contextmanager
def listening(wanted: Listener | Callback | bool | None) -> Iterator[Listener]:
    """Who hears of a study: a line for each cell, a caller's object or function, or nobody.

    Raises `UsageError` for anything else.
    """
    if wanted is True:
        from stlbench.study.progress import Progress

        with Progress() as lines:
            yield lines
    elif isinstance(wanted, Listener):
        yield wanted
    elif wanted is None or wanted is False:
        yield Silent()
    elif callable(wanted):
        yield _Calling(wanted)
    else:
        raise UsageError(f"progress should be True, a function or a `Listener`, got {one_line(repr(wanted))}")


class _Thread:
    """One log, in a thread. A call that hangs keeps nothing but this thread, which ends with the process."""

    def __init__(self, name: str, log: RunLog) -> None:
        self.name, self.log = name, log
        self.fault = ""
        self.since: float | None = None
        """When the call began that is going on."""
        self._calls = SimpleQueue[Callable[[], None] | None]()
        self._thread = threading.Thread(target=self._run, name=f"log {name}", daemon=True)
        self._thread.start()

    def tell(self, call: Callable[[], None], now: float) -> None:
        if self.since is not None and now - self.since > _MOST_SECONDS:
            self.fault = self.fault or f"one call takes more than {_MOST_SECONDS:g} s"
        if not self.fault:
            self._calls.put(call)

    def close(self, seconds: float) -> None:
        if not self.fault:
            self._calls.put(None)
            self._thread.join(seconds)
            if self._thread.is_alive():
                self.fault = f"it did not come to its end within {seconds:g} s"

    def _run(self) -> None:
        while (call := self._calls.get()) is not None and not self.fault:
            self.since = time.monotonic()
            try:
                call()
            except BaseException as error:  # also one that would end the process
                self.fault = self.fault or cause(error)
            self.since = None


class Logged:
    """The progress of a run that logs are told of too; as a context manager it ends them."""

    def __init__(self, logs: dict[str, RunLog], folder: Path, progress: Listener) -> None:
        """Raises `UsageError` if there is a link in the folder, through which a log might write."""
        for place, *below in os.walk(folder) if logs else ():
            for name in chain(*below):
                if (path := Path(place, name)).is_symlink():
                    inside(path, folder)
        self._threads = [_Thread(name, log) for name, log in logs.items()]
        self._folder, self._told = folder, progress
        self._said = set[str]()
        self._begun = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        if self._begun:
            self._tell(lambda log: log.end())
        for thread in self._threads:
            thread.close(_END_SECONDS)
        self._faults()

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        self._told.begin(missing, done)
        folder, cells = self._folder.absolute(), tuple(cell.name for cell in missing)
        self._begun = True
        self._tell(lambda log: log.begin(folder, cells))

    def note(self, text: str) -> None:
        self._told.note(text)

    def ended(self, result: Result) -> None:
        self._told.ended(result)
        cell = logged(result)
        self._tell(lambda log: log.ended(cell))
        self._faults()

    def _tell(self, call: Callable[[RunLog], None]) -> None:
        for thread in self._threads:
            thread.tell(partial(call, thread.log), time.monotonic())

    def _faults(self) -> None:
        for thread in self._threads:
            if thread.fault and thread.name not in self._said:
                self._said.add(thread.name)
                self._told.note(f"log {thread.name} is turned off: {thread.fault}; the run goes on")
