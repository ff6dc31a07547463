"""Slots, in which the items of a run are executed one after the other, and the server that forks their keepers.

The server imports everything once. A keeper is forked from it for each slot, and forks a process for each item.
"""

from __future__ import annotations

import atexit
import gc
import math
import os
import pickle
import signal
import sys
import threading
import time
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from types import ModuleType
from typing import Any

import psutil

from stlbench_executors.cell import adopt, end_strays
from stlbench_executors.keeper import Ended, Task, keep


class Server(SpawnProcess):
    """A fresh interpreter, which does not run the user's script again, as a spawned one does.

    Args:
        links: the far end of the link to each keeper.
        limit: bytes of memory that the processes of an item may take together.
        prepare: pickled: what to call before the first item. What it raises is passed over: an item meets it again.
    """

    def __init__(self, links: Sequence[Connection], limit: int, prepare: bytes) -> None:
        super().__init__(target=_serve, args=(links, limit, prepare))

    @staticmethod
    def _Popen(process: Any) -> Any:  # noqa: N802 - the name is that of multiprocessing
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return SpawnProcess._Popen(process)
        finally:
            sys.modules["__main__"] = script


def _serve(links: Sequence[Connection], limit: int, prepare: bytes) -> None:
    os.setsid()  # a ctrl-C in the terminal is for the harness
    adopt()
    with suppress(BaseException):
        pickle.loads(prepare)()  # noqa: S301 - from our own parent
    if psutil.Process().num_threads() > 1:
        os._exit(1)  # a fork would copy locks that nobody lets go of; the next server prepares nothing
    gc.collect()
    gc.freeze()  # what is never looked at by a garbage collection stays shared with all that is forked
    keepers = {_forked(link, links, limit) for link in links}
    for link in links:
        link.close()
    while keepers:
        keepers.discard(os.wait()[0])
        end_strays(keepers)


def _forked(own: Connection, links: Sequence[Connection], limit: int) -> int:
    """The number of a keeper, in whose process this never returns."""
    process = os.fork()
    if process:
        return process
    try:
        for link in links:
            if link is not own:
                link.close()
        keep(own, limit)
    finally:
        os._exit(0)


ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Read when numpy or torch is imported, so a server must be born with them."""

if not hasattr(signal, "pthread_sigmask"):
    raise ImportError("stopping workers needs POSIX signals: Linux, macOS, or WSL on Windows")

START_SECONDS = 120.0
"""A server whose keepers have not said that they are there by then is replaced."""

LOOK_SECONDS = 2.0
"""How often, at most, it is looked at whether a slot is stuck."""

STARTS = 3
"""How many servers are started in place of one that ends or hangs before its keepers are there."""

UNTAKEN = f"{STARTS} worker processes, one after the other, ended or hung before they took it"
"""Of an item for which no slot has a keeper any more."""

GRACE_SECONDS = 30.0
"""A keeper that says nothing so long after the deadline of its item is killed."""

STOP_SECONDS = 10.0
"""The longest that keepers are waited for that were told to end what runs."""


class Site:
    """What slots have in common.

    Args:
        memory: bytes that the processes of one item may take together.
        prepare: pickled: what to call before the first item, in the process from which those of items are forked.
    """

    def __init__(self, memory: int, prepare: bytes) -> None:
        self.memory, self.prepare = memory, prepare
        self.servers = list[Server]()


class Slot:
    """One keeper after the other, and the item that the present one has."""

    def __init__(self, site: Site) -> None:
        self.link: Connection | None = None
        self.server: Server | None = None
        self.site = site
        self._keeper, self._starts = 0, 0
        self._task: Task | None = None
        _SLOTS.add(self)

    @property
    def is_busy(self) -> bool:
        """It has an item."""
        return self._task is not None

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
        return far, self.site.prepare if self._starts == 1 else b""

    def take(self, task: Task) -> bool:
        """Give the item to the keeper; False where that has ended meanwhile."""
        assert self.link is not None
        try:
            self.link.send(task)
        except OSError:
            self._lost()
            return False
        self._task, self._since = task, time.monotonic()
        return True

    def heard(self) -> Ended | None:
        """What the keeper says: that it is there, or how its item ended."""
        assert self.link is not None
        try:
            said = self.link.recv()
        except (EOFError, OSError):
            return self._lost()
        if not self._keeper:
            self._keeper, self._starts = said, 0
            return None
        self._task = None
        assert isinstance(said, Ended)
        return said

    def look(self) -> None:
        """Kill a keeper, or its server, that should have been heard long ago."""
        if self.link is not None and time.monotonic() - self._since > self._patience:
            self.kill()

    @property
    def _patience(self) -> float:
        if self._task is not None:
            return self._task.deadline + GRACE_SECONDS
        return math.inf if self._keeper else START_SECONDS

    def _lost(self) -> Ended | None:
        """The keeper has ended: how its item did, and another one, unless none has come for some time."""
        task, late = self._task, time.monotonic() - self._since > self._patience
        self.close()
        if self._starts < STARTS:
            start([self])
        if task is None:
            return None
        if late:
            return Ended("timeout", reason=f"no result after {task.deadline:g} s")
        return Ended("killed", reason="the process that watched over it ended")

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
            self.link = self._task = None


_SLOTS, _OWNER, _STARTING = weakref.WeakSet[Slot](), os.getpid(), threading.Lock()


def start(slots: list[Slot]) -> None:
    """A server, and from it a keeper for each of the slots, which are of one site."""
    with _STARTING, _environment(ONE_THREAD):
        begun = [slot.begin() for slot in slots]
        site = slots[0].site
        server = Server([far for far, _ in begun], site.memory, begun[0][1])
        with _blocked_interrupts():
            server.start()
        site.servers = [server, *(other for other in site.servers if other.is_alive())]
        for slot, (far, _) in zip(slots, begun, strict=True):
            slot.server = server
            far.close()


def stop(slots: Iterable[Slot]) -> None:
    """End all that runs, and wait for it."""
    end, linked = time.monotonic() + STOP_SECONDS, list(slots)
    for slot in linked:
        slot.stop()
    for slot in linked:
        slot.wait(end)
    for server in {server for slot in linked for server in slot.site.servers}:
        server.join(max(1.0, end - time.monotonic()))
        server.kill()  # where it is still there
        server.join()


@atexit.register
def _stop_all() -> None:
    """Where the caller has not closed the iterator; otherwise multiprocessing would wait for servers for ever."""
    if os.getpid() == _OWNER:  # a child that the caller has forked has nothing to stop
        stop(_SLOTS)


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
