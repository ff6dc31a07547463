"""The process that supervises items: it forks a process for each, and ends it with all that it started.

It is forked from a process that has imported everything (`pool.Server`). So an item begins within milliseconds, and
sees nothing that another item has changed.
"""

from __future__ import annotations

import os
import pickle
import selectors
import signal
import tempfile
import time
import traceback
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager, nullcontext, suppress
from functools import cache
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO, Literal, NamedTuple

from stlbench_executors import item_process
from stlbench_executors.item_process import adopt, end_below, memory_below, text_of

CHECK_SECONDS = 0.1  # between two measurements of memory, at least
CHECK_SHARE = 0.02  # the most of a core that these measurements take: a long tree of processes is measured less often


class Task(NamedTuple):
    work: bytes  # pickled: a function and what to call it with
    deadline: float  # wall seconds
    log: Path | None  # file for what it writes to standard output and error
    facts: bytes = b""  # pickled: a function that describes where the item runs; empty if the harness does not want it


class Ended(NamedTuple):
    status: Literal["answered", "timeout", "killed"]
    answer: bytes = b""  # pickled: a `item_process.Answer`, if it answered
    reason: str = ""
    facts: Mapping[str, str] | None = None  # the machine on which it ran; None if that is not known


class _Closed(Exception):
    """The harness wants no more, or has ended."""


def supervise(link: Connection, limit: int) -> None:
    """Run items until the other end of the link says None or is closed; each may take `limit` bytes of memory.

    The link gives each `Task` and takes its `Ended`. First it takes this process' number.
    """
    adopt()
    link.send(os.getpid())
    with suppress(EOFError, OSError, _Closed):
        while (task := link.recv()) is not None:
            link.send(_run(task, link, limit)._replace(facts=_facts(task.facts)))


@cache
def _facts(function: bytes) -> dict[str, str]:
    return dict(pickle.loads(function)()) if function else {}  # noqa: S301 - from our own parent


def _run(task: Task, link: Connection, limit: int) -> Ended:
    with tempfile.TemporaryFile() as answer, closing(Log(task.log)) if task.log else nullcontext() as log:
        process = os.fork()
        if process == 0:
            link.close()
            _become_cell(task, answer, log)
        try:
            return _Watcher(process, task, link, log, limit).ended(answer)
        finally:
            end_below(process)


def _become_cell(task: Task, answer: IO[bytes], log: Log | None) -> None:
    """Never returns."""
    try:
        item_process.run(task.work, os.getppid(), answer.fileno(), log.writing if log else None)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(1)


class _Watcher:
    """Waits for the end of an item, and watches its output, the link, the clock and the memory."""

    def __init__(self, process: int, task: Task, link: Connection, log: Log | None, limit: int) -> None:
        self._process, self._task, self._link, self._log, self._limit = process, task, link, log, limit
        self._end = time.monotonic() + task.deadline
        self._next_check = time.monotonic() + CHECK_SECONDS
        self._exit: int | None = None
        self._selector = selectors.DefaultSelector()
        self._selector.register(link, selectors.EVENT_READ)
        if log:
            self._selector.register(log.reading, selectors.EVENT_READ)

    def ended(self, answer: IO[bytes]) -> Ended:
        with self._selector, _notice_of(self._process, self._selector):
            while not self._has_ended():
                if time.monotonic() >= self._end:
                    return Ended("timeout", reason=f"no result after {self._task.deadline:g} s")
                if used := self._excess():
                    return Ended(
                        "killed", reason=f"it took {text_of(used)} of memory, its limit is {text_of(self._limit)}"
                    )
                self._wait()
        answer.seek(0)
        content = answer.read()
        if content and self._exit == 0:
            return Ended("answered", content)
        return Ended("killed", reason=_death(self._exit or 0))

    def _has_ended(self) -> bool:
        ended, status = os.waitpid(self._process, os.WNOHANG)
        if ended:
            self._exit = os.waitstatus_to_exitcode(status)
        return bool(ended)

    def _wait(self) -> None:
        until = min(self._end, self._next_check) - time.monotonic()
        for key, _ in self._selector.select(max(0.0, until)):
            if key.fileobj is self._link:
                raise _Closed
            if self._log and key.fd == self._log.reading and not self._log.take():
                self._selector.unregister(key.fileobj)

    def _excess(self) -> int:
        """Bytes of memory in use if they exceed the limit, else 0."""
        now = time.monotonic()
        if now < self._next_check:
            return 0
        begin = time.process_time()
        used = memory_below(self._limit)
        self._next_check = now + max(CHECK_SECONDS, (time.process_time() - begin) / CHECK_SHARE)
        return used if used > self._limit else 0


@contextmanager
def _notice_of(process: int, selector: selectors.BaseSelector) -> Iterator[None]:
    """Wake the selector when a process ends, even if another has inherited its pipes; some systems cannot do so."""
    try:
        descriptor = os.pidfd_open(process)
    except (AttributeError, OSError):
        yield
        return
    selector.register(descriptor, selectors.EVENT_READ)
    try:
        yield
    finally:
        os.close(descriptor)


def _death(code: int) -> str:
    if code >= 0:
        return f"the process ended with exit code {code}"
    try:
        return f"killed by signal {-code} ({signal.Signals(-code).name})"
    except ValueError:
        return f"killed by signal {-code}"


PART = 64 * 1024  # bytes of the beginning that a log contains, and as many of the end


class Log:
    """A pipe whose content goes to a file. It removes an older file, and makes none if nothing is written."""

    def __init__(self, path: Path) -> None:
        self.reading, self.writing = os.pipe()
        os.set_blocking(self.reading, False)
        self._path, self._length, self._tail = path, 0, bytearray()
        with suppress(OSError):
            if not path.parent.is_symlink():
                path.unlink(missing_ok=True)

    def take(self) -> bool:
        """Read what is there; False once the pipe is closed."""
        for _ in range(64):  # not for ever, if a cell writes faster
            try:
                data = os.read(self.reading, PART)
            except BlockingIOError:
                return True
            if not data:
                return False
            room = max(0, PART - self._length)
            self._length += len(data)
            self._write(data[:room])
            self._tail = (self._tail + data[room:])[-PART:]
        return True

    def close(self) -> None:
        """Write the end, and before it how many bytes were left out."""
        os.close(self.writing)
        self.take()
        os.close(self.reading)
        left_out = self._length - PART - len(self._tail)
        if left_out > 0:
            self._write(f"\n... {left_out} bytes left out ...\n".encode())
        self._write(bytes(self._tail))

    def _write(self, data: bytes) -> None:
        if data:
            with suppress(OSError):  # a full disk, or a link: the cell may go on without a log
                self._path.parent.mkdir(parents=True, exist_ok=True)
                folder = os.open(self._path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
                try:
                    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW
                    with open(os.open(self._path.name, flags, 0o666, dir_fd=folder), "ab") as file:
                        file.write(data)
                finally:
                    os.close(folder)
