"""Processes on this machine: `jobs` at a time, a fresh one for each item.

Why not a process pool: the well-kept ones (pebble, loky, concurrent.futures) use a process again for the next item,
which then sees what the one before has changed; told to use each once, they start an interpreter and import everything
for each, for seconds. The fork server of multiprocessing is one for the whole life of the calling process, so that it
goes on with old code after a plugin has been edited, and ends no grandchildren. Here a server is made for each run:

    this process -> server, which imports everything -> a keeper for each job -> a process for each item

A keeper (`keeper`) watches one item at a time: its deadline, its memory, its output, its end.
"""

from __future__ import annotations

import atexit
import math
import os
import pickle
import signal
import time
import traceback
import weakref
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe, connection, resource_tracker
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from stlbench.contract import Executor, Outcome, Work, cause
from stlbench_executors.cell import Answer
from stlbench_executors.keeper import Ended, Task
from stlbench_executors.memory import Memory, share
from stlbench_executors.server import Server

__all__ = ["LocalExecutor"]

ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Read when numpy or torch is imported, so a server must be born with them."""

if not hasattr(signal, "pthread_sigmask"):
    raise ImportError("stopping workers needs POSIX signals: Linux, macOS, or WSL on Windows")

START_SECONDS = 120.0
"""A server whose keepers have not said that they are there by then is replaced."""

LOOK_SECONDS = 2.0
"""How often it is looked at whether one is stuck."""

STARTS = 3
"""How many servers are started in place of one that ends or hangs before its keepers are there."""

GRACE_SECONDS = 30.0
"""A keeper that says nothing so long after the deadline of its item is killed."""

STOP_SECONDS = 10.0
"""The longest that keepers are waited for that were told to end what runs."""


class LocalExecutor(Executor):
    """Processes on this machine, each with one thread for linear algebra.

    Each item has a process of its own, which ends with the item, and with it all that the item has started. What an
    item changes, in modules, settings or files that are open, no other item sees. A deadline counts from when the
    item's process is there, with what the harness needs imported.

    Attributes:
        memory: bytes that the processes of one item may take together; it is killed where they take more.
    """

    def __init__(self, *, jobs: Annotated[int, Field(ge=1)] = 1, memory: Memory | None = None) -> None:
        super().__init__(jobs=jobs)
        self.memory = memory or share(jobs)

    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:
        """See `Executor.run`."""
        if len(deadlines) != len(items) or any(deadline <= 0 for deadline in deadlines):
            raise ValueError("each item needs a deadline, in seconds and greater than 0")
        plan = _Plan(function if isinstance(function, Work) else Work(function), items, deadlines, self.memory)
        slots = [_Slot(plan) for _ in range(min(self.jobs, len(items)))]
        if not slots:
            return
        with _environment(ONE_THREAD):
            try:
                _start(slots)
                yield from _outcomes(slots, len(items))
            finally:
                _stop(slots)


class _Plan:
    """What is to be run, and how."""

    def __init__(self, work: Work, items: Sequence[Any], deadlines: Sequence[float], memory: int) -> None:
        self.deadlines, self.memory = deadlines, memory
        self.prepare = pickle.dumps(work.prepare)
        self.servers = list[Server]()
        self._work, self._items = work, items

    def task(self, index: int) -> Task:
        """What a keeper is given."""
        item = self._items[index]
        log = None if self._work.log is None else Path(self._work.log(item)).absolute()
        return Task(pickle.dumps((self._work.function, item)), self.deadlines[index], log)


def _outcomes(slots: list[_Slot], count: int) -> Generator[Outcome]:
    waiting = deque(range(count))
    while waiting or any(slot.is_busy for slot in slots):
        for slot in slots:
            if waiting and slot.is_idle and slot.take(waiting[0]):
                waiting.popleft()
        links = {slot.link: slot for slot in slots if slot.link is not None}
        if not links:
            untaken = f"{STARTS} worker processes, one after the other, ended or hung before they took it"
            yield from (Outcome(index, "killed", reason=untaken) for index in waiting)
            return
        ready = connection.wait(list(links), timeout=min(LOOK_SECONDS, START_SECONDS / 4))
        for link, slot in links.items():
            if link in ready and (outcome := slot.heard()) is not None:
                yield outcome
        for slot in slots:
            slot.look()


class _Slot:
    """One keeper after the other, and the item that the present one has."""

    def __init__(self, plan: _Plan) -> None:
        self.link: Connection | None = None
        self.server: Server | None = None
        self.plan = plan
        self._keeper, self._starts, self._index = 0, 0, -1
        _SLOTS.add(self)

    @property
    def is_busy(self) -> bool:
        """It has an item."""
        return self._index >= 0

    @property
    def is_idle(self) -> bool:
        """Its keeper waits for an item."""
        return self.link is not None and self._keeper > 0 and not self.is_busy

    def begin(self) -> tuple[Connection, bytes]:
        """Expect a keeper: the far end of the link to it, and what is to be prepared; nothing, where that ended a
        server before."""
        self.link, far = Pipe()
        self._keeper, self._since = 0, time.monotonic()
        self._starts += 1
        return far, self.plan.prepare if self._starts == 1 else b""

    def take(self, index: int) -> bool:
        """Give the item to the keeper; False where that has ended meanwhile."""
        assert self.link is not None
        try:
            self.link.send(self.plan.task(index))
        except OSError:
            self._lost()
            return False
        self._index, self._since = index, time.monotonic()
        return True

    def heard(self) -> Outcome | None:
        """What the keeper says: that it is there, or how its item ended."""
        assert self.link is not None
        try:
            said = self.link.recv()
        except (EOFError, OSError):
            return self._lost()
        if not self._keeper:
            self._keeper, self._starts = said, 0
            return None
        index, self._index = self._index, -1
        return _outcome(index, said)

    def look(self) -> None:
        """Kill a keeper, or its server, that should have been heard long ago."""
        if self.link is not None and time.monotonic() - self._since > self._patience:
            self.kill()

    @property
    def _patience(self) -> float:
        if self.is_busy:
            return self.plan.deadlines[self._index] + GRACE_SECONDS
        return math.inf if self._keeper else START_SECONDS

    def _lost(self) -> Outcome | None:
        """The keeper has ended: how its item did, and another one, unless none has come for some time."""
        index, late = self._index, time.monotonic() - self._since > self._patience
        self.close()
        self._index = -1
        if self._starts < STARTS:
            _start([self])
        if index < 0:
            return None
        if late:
            return Outcome(index, "timeout", reason=f"no result after {self.plan.deadlines[index]:g} s")
        return Outcome(index, "killed", reason="the process that watched over it ended")

    def stop(self) -> None:
        """Tell the keeper to end what runs."""
        if self.link is not None and self._keeper:
            with suppress(OSError):
                self.link.send(None)

    def wait(self, end: float) -> None:
        """Until it has, or the time comes at which it is killed; a server without keepers is killed at once."""
        if self.link is not None:
            with suppress(EOFError, OSError):
                while self._keeper and self.link.poll(max(0.0, end - time.monotonic())):
                    self.link.recv()
                self.kill()
        self.close()

    def kill(self) -> None:
        """End the keeper, or the server where there is none yet, whatever it does."""
        if self._keeper:
            with suppress(ProcessLookupError):
                os.kill(self._keeper, signal.SIGKILL)
        elif self.server is not None:
            self.server.kill()

    def close(self) -> None:
        """Let go of the link; a keeper that is there sees it and ends."""
        if self.link is not None:
            self.link.close()
            self.link = None


_SLOTS, _OWNER = weakref.WeakSet[_Slot](), os.getpid()


def _start(slots: list[_Slot]) -> None:
    """A server, and from it a keeper for each slot."""
    begun = [slot.begin() for slot in slots]
    plan = slots[0].plan
    server = Server([far for far, _ in begun], plan.memory, begun[0][1])
    with _blocked_interrupts():
        server.start()
    plan.servers = [server, *(other for other in plan.servers if other.is_alive())]
    for slot, (far, _) in zip(slots, begun, strict=True):
        slot.server = server
        far.close()


def _stop(slots: Iterable[_Slot]) -> None:
    """End all that runs, and wait for it."""
    end, linked = time.monotonic() + STOP_SECONDS, list(slots)
    for slot in linked:
        slot.stop()
    for slot in linked:
        slot.wait(end)
    for server in {server for slot in linked for server in slot.plan.servers}:
        server.join(max(1.0, end - time.monotonic()))
        server.kill()  # where it is still there
        server.join()


@atexit.register
def _stop_all() -> None:
    """Where the caller has not closed the iterator; otherwise multiprocessing would wait for servers for ever."""
    if os.getpid() == _OWNER:  # a child that the caller has forked has nothing to stop
        _stop(_SLOTS)


def _outcome(index: int, said: Ended) -> Outcome:
    if said.status != "answered":
        return Outcome(index, said.status, reason=said.reason)
    try:
        answer = Answer(*pickle.loads(said.answer))  # noqa: S301 - from our own process
        if answer.reason:
            return Outcome(index, "raised", reason=answer.reason, details=answer.details)
        return Outcome(index, "done", pickle.loads(answer.value))  # noqa: S301 - as above
    except Exception as error:
        return Outcome(index, "raised", reason=cause(error), details=traceback.format_exc())


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
    """What starts meanwhile never sees a ctrl-C, not even while Python starts up."""
    resource_tracker.ensure_running()  # when a process start begins it, it unblocks the signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
