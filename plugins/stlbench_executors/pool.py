"""A pool of slots, which run items one after the other, each by a supervisor that a server has forked: a fresh
interpreter that imports everything once.

A supervisor forks a process for each item.
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
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe, resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from types import ModuleType
from typing import Any

import psutil

from stlbench_executors.item_process import adopt, end_strays
from stlbench_executors.supervisor import Ended, Task, supervise

if not hasattr(signal, "pthread_sigmask"):
    raise ImportError("stopping workers needs POSIX signals: Linux, macOS, or WSL on Windows")

ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Read when numpy or torch is imported, so a server must be born with them."""


class Server(SpawnProcess):
    """A fresh interpreter, which does not run the user's script again. It forks a supervisor for each link."""

    def __init__(self, links: Sequence[Connection], limit: int, prepare: bytes) -> None:
        super().__init__(target=_serve, args=(links, limit, prepare))

    def start(self) -> None:
        with _environment(ONE_THREAD), _blocked_interrupts():
            super().start()

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
        os._exit(1)  # a fork would copy locks that no thread releases; the next server prepares nothing
    gc.collect()
    gc.freeze()  # memory that no garbage collection visits stays shared with all forks
    supervisors = {_forked(link, links, limit) for link in links}
    for link in links:
        link.close()
    while supervisors:
        supervisors.discard(os.wait()[0])
        end_strays(supervisors)


def _forked(own: Connection, links: Sequence[Connection], limit: int) -> int:
    """The process number of a supervisor. In its own process this never returns."""
    process = os.fork()
    if process:
        return process
    try:
        for link in links:
            if link is not own:
                link.close()
        supervise(own, limit)
    finally:
        os._exit(0)


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
    """Processes that start meanwhile never receive a ctrl-C, not even while Python starts up."""
    resource_tracker.ensure_running()  # when a process start begins it, it unblocks the signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


START_SECONDS = 120.0  # a server whose supervisors have not reported by then is replaced
CHECK_SECONDS = 2.0  # between two checks whether a slot is stuck, at most
STARTS = 3  # servers that are started in place of one that ends or hangs before its supervisors are there

UNTAKEN = f"{STARTS} worker processes, one after the other, ended or hung before they took it"
"""The reason for an item for which no slot has a supervisor any more."""

GRACE_SECONDS = 30.0  # a supervisor that is silent so long after the deadline of its item is killed
STOP_SECONDS = 10.0  # supervisors may take so long to end what runs


class Slot:
    """One supervisor after the other, and the item that the present one has."""

    def __init__(self, pool: Pool) -> None:
        self.link: Connection | None = None
        self.server: Server | None = None
        self._pool = pool
        self._supervisor, self._starts = 0, 0
        self._task: Task | None = None

    @property
    def is_idle(self) -> bool:
        return self.link is not None and self._supervisor > 0 and self._task is None

    def begin(self) -> tuple[Connection, bytes]:
        """Make a link for a new supervisor: its far end, and the work to prepare; none if that has ended a server."""
        self.link, far = Pipe()
        self._supervisor, self._since = 0, time.monotonic()
        self._starts += 1
        return far, self._pool.prepare if self._starts == 1 else b""

    def take(self, task: Task) -> bool:
        """Give the item to the supervisor; False if it has ended meanwhile."""
        assert self.link is not None
        try:
            self.link.send(task)
        except OSError:
            self._lost()
            return False
        self._task, self._since = task, time.monotonic()
        return True

    def receive(self) -> Ended | None:
        """Read the supervisor's message: None for its process number, else the end of its item."""
        assert self.link is not None
        try:
            message = self.link.recv()
        except (EOFError, OSError):
            return self._lost()
        if not self._supervisor:
            self._supervisor, self._starts = message, 0
            return None
        self._task = None
        assert isinstance(message, Ended)
        return message

    def check(self) -> None:
        if self.link is not None and time.monotonic() - self._since > self._patience:
            self.kill()

    @property
    def _patience(self) -> float:
        if self._task is not None:
            return self._task.deadline + GRACE_SECONDS
        return math.inf if self._supervisor else START_SECONDS

    def _lost(self) -> Ended | None:
        """The end of the item of a supervisor that has ended. Another one is started, up to `STARTS` times."""
        task, late = self._task, time.monotonic() - self._since > self._patience
        self.close()
        if self._starts < STARTS:
            self._pool.start([self])
        if task is None:
            return None
        if late:
            return Ended("timeout", reason=f"no result after {task.deadline:g} s")
        return Ended("killed", reason="the process that watched over it ended")

    def stop(self) -> None:
        if self.link is not None and self._supervisor:
            with suppress(OSError):
                self.link.send(None)

    def wait(self, end: float) -> None:
        """Wait until it has, and kill it at the given time; a server without supervisors is killed at once."""
        if self.link is not None:
            with suppress(EOFError, OSError):
                while self._supervisor and self.link.poll(max(0.0, end - time.monotonic())):
                    self.link.recv()
                self.kill()
        self.close()

    def kill(self) -> None:
        if self._supervisor:
            with suppress(ProcessLookupError):
                os.kill(self._supervisor, signal.SIGKILL)
        elif self.server is not None:
            self.server.kill()

    def close(self) -> None:
        """Close the link, upon which the supervisor ends."""
        if self.link is not None:
            self.link.close()
            self.link = self._task = None


class Pool:
    """Slots in which items run at the same time, each within `memory` bytes, after `prepare`, pickled, was called."""

    def __init__(self, memory: int, prepare: bytes, size: int) -> None:
        self.memory, self.prepare = memory, prepare
        self.slots = [Slot(self) for _ in range(size)]
        self._servers = list[Server]()
        _POOLS.add(self)

    def start(self, slots: Sequence[Slot]) -> None:
        with _STARTING:
            begun = [slot.begin() for slot in slots]
            server = Server([far for far, _ in begun], self.memory, begun[0][1])
            server.start()
            self._servers = [server, *(other for other in self._servers if other.is_alive())]
            for slot, (far, _) in zip(slots, begun, strict=True):
                slot.server = server
                far.close()

    def stop(self) -> None:
        end = time.monotonic() + STOP_SECONDS
        for slot in self.slots:
            slot.stop()
        for slot in self.slots:
            slot.wait(end)
        for server in self._servers:
            server.join(max(1.0, end - time.monotonic()))
            server.kill()  # if it is still there
            server.join()


_POOLS, _OWNER, _STARTING = weakref.WeakSet[Pool](), os.getpid(), threading.Lock()


@atexit.register
def _stop_all() -> None:
    """Stop servers, for which multiprocessing would wait for ever if the caller has not closed the iterator."""
    if os.getpid() == _OWNER:  # a child that the caller has forked has nothing to stop
        for pool in _POOLS:
            pool.stop()
