"""Processes on this machine: `jobs` workers that are used again and again, each in a pool of its own."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import connection, resource_tracker
from multiprocessing.context import SpawnContext, SpawnProcess
from types import ModuleType
from typing import Annotated, Any

from pydantic import Field

from stlbench.contract import Executor, Outcome, cause

__all__ = ["LocalExecutor"]

ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Read when numpy or torch is imported, so a worker must be born with them."""

if not hasattr(signal, "pthread_sigmask"):
    raise ImportError("stopping workers needs POSIX signals: Linux, macOS, or WSL on Windows")

START_SECONDS = 120.0
"""A worker that has not taken its item by then is replaced."""

LOOK_SECONDS = 2.0
"""How often it is looked at whether workers are stuck."""

STARTS = 3
"""How many workers an item is offered to, where one after the other ends or hangs without taking it."""


class LocalExecutor(Executor):
    """Processes on this machine, each with one thread for linear algebra.

    An item that raises, runs past its deadline, or takes its process down leaves the others alone: every worker has
    a pool of its own, with at most one item in it. A deadline counts from when a worker takes the item, and includes
    the import of what the function needs.
    """

    def __init__(self, *, jobs: Annotated[int, Field(ge=1)] = 1) -> None:
        super().__init__(jobs=jobs)

    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:
        """See `Executor.run`."""
        if len(deadlines) != len(items) or any(deadline <= 0 for deadline in deadlines):
            raise ValueError("each item needs a deadline, in seconds and greater than 0")
        slots = [_Slot(function, items, deadlines) for _ in range(min(self.jobs, len(items)))]
        with _environment(ONE_THREAD):
            try:
                yield from _outcomes(slots, len(items))
            finally:
                _stop(slots)


def _outcomes(slots: list[_Slot], count: int) -> Generator[Outcome]:
    waiting, idle, busy = iter(range(count)), slots, dict[Future[Any], _Slot]()
    while True:
        busy |= {slot.take(index): slot for slot, index in zip(idle, waiting, strict=False)}
        if not busy:
            return
        ended, running = wait(busy, timeout=min(LOOK_SECONDS, START_SECONDS / 4), return_when=FIRST_COMPLETED)
        idle = []
        for future in [*ended, *(future for future in running if busy[future].is_stuck)]:
            slot = busy.pop(future)
            outcome = slot.outcome()
            if outcome is None:
                busy[slot.offer()] = slot
            else:
                idle.append(slot)
                yield outcome


class _Slot:
    """One worker after the other, and the item that the present one has.

    pebble loses items where a pool has several workers and one dies between taking an item and saying so, and breaks
    the whole pool where an idle worker dies. With one worker and one item per pool, either is seen and put right here.
    """

    def __init__(self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]) -> None:
        self._function, self._items, self._deadlines = function, items, deadlines
        self.pool: Any = None  # pebble is not typed throughout

    def take(self, index: int) -> Future[Any]:
        """Take over the item with this index."""
        self._index, self._offers = index, 0
        return self.offer()

    def offer(self) -> Future[Any]:
        """Give the item to the worker, or to a fresh one where there is none that works."""
        work = pickle.dumps((self._function, self._items[self._index]))
        with _blocked_interrupts():
            try:
                self._future = self._schedule(work)
            except RuntimeError:  # the worker died while it was idle
                self.stop()
                self._future = self._schedule(work)
        self._offers, self._since = self._offers + 1, time.monotonic()
        return self._future

    def _schedule(self, work: bytes) -> Future[Any]:
        if self.pool is None:
            from pebble import ProcessPool  # imports asyncio, which a study that is done already does without

            self.pool = ProcessPool(1, initializer=_prepare, context=_Context())
        future: Future[Any] = self.pool.schedule(_call, (work,), timeout=self._deadlines[self._index])
        return future

    @property
    def is_stuck(self) -> bool:
        """The worker has not taken the item for a long time; or its pool broke, which pebble does not always tell."""
        untaken = not (self._future.running() or self._future.done())
        return untaken and (not self.pool.active or time.monotonic() - self._since > START_SECONDS)

    def outcome(self) -> Outcome | None:
        """How the item ended; None where no worker took it and it is to be offered again."""
        from pebble import ProcessExpired

        try:
            if not self._future.done():
                raise BrokenProcessPool
            answer = self._future.result()
        except TimeoutError:
            return Outcome(self._index, "timeout", reason=f"no result after {self._deadlines[self._index]:g} s")
        except ProcessExpired as error:
            return Outcome(self._index, "killed", reason=_death(error.exitcode))
        except BrokenProcessPool:
            self.stop()
            untaken = f"{STARTS} worker processes, one after the other, ended or hung before they took it"
            return Outcome(self._index, "killed", reason=untaken) if self._offers >= STARTS else None
        return _ended(self._index, *answer)

    def stop(self) -> None:
        """End the worker, whatever it does."""
        if self.pool is not None:
            self.pool.stop()
            self.pool.join()
            self.pool = None


def _stop(slots: list[_Slot]) -> None:
    for slot in slots:
        if slot.pool is not None:
            slot.pool.stop()  # tell all before waiting for the first
    for slot in slots:
        slot.stop()


def _ended(index: int, answer: bytes, reason: str, details: str) -> Outcome:
    if not reason:
        try:
            return Outcome(index, "done", pickle.loads(answer))  # noqa: S301 - from our own worker
        except Exception as error:
            reason, details = _described(error)
    return Outcome(index, "raised", reason=reason, details=details)


def _described(error: BaseException) -> tuple[str, str]:
    """The exception being handled, in one line and in full."""
    return cause(error), traceback.format_exc()


def _death(code: int) -> str:
    if code >= 0:
        return f"the process ended with exit code {code}"
    try:
        return f"killed by signal {-code} ({signal.Signals(-code).name})"
    except ValueError:
        return f"killed by signal {-code}"


class _Worker(SpawnProcess):
    """A process that does not run the user's script again, as a spawned one does: it has the importable function."""

    @staticmethod
    def _Popen(process: Any) -> Any:  # noqa: N802 - the name is that of multiprocessing
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return SpawnProcess._Popen(process)
        finally:
            sys.modules["__main__"] = script


class _Context(SpawnContext):
    Process = _Worker


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Set variables for the processes that start meanwhile; numpy is imported here already and does not look."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _blocked_interrupts() -> Iterator[None]:
    """What starts meanwhile, threads and processes, never sees a ctrl-C, not even while Python starts up."""
    resource_tracker.ensure_running()  # when a process start begins it, it unblocks the signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


# ---------------------------------------------------------------------------------------------------- in the worker


def _prepare() -> None:
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # ends compiled code too; pebble's handler waits for Python
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


def _call(work: bytes) -> tuple[bytes, str, str]:
    """Value, reason and traceback of the item. All that may fail is in here: reading it, running it, writing it."""
    try:
        function, item = pickle.loads(work)  # noqa: S301 - from our own parent
        return pickle.dumps(function(item)), "", ""
    except BaseException as error:
        return b"", *_described(error)
