"""One run at a time in a folder of results: a process that writes holds its lock until it ends."""

from __future__ import annotations

import fcntl
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path

from stlbench.errors import UsageError, one_line, unwritable
from stlbench.records.inputs import is_there, read, to_read
from stlbench.records.outputs import inside

FILE = ".lock"  # its name in a folder of results. It stays there; what counts is whether a process holds it.
_PATIENCE = 0.5  # seconds for which a lock is tried


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder of results, which is made if it is missing.

    Raises `UsageError` if another process holds it, with its name, or if the folder cannot be written.
    """
    path = folder / FILE
    try:
        inside(path, folder).parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o666)
    except OSError as error:
        raise unwritable(f"cannot write results in {folder}", error) from error
    try:
        _hold(descriptor, path)
        yield
    finally:
        os.close(descriptor)


def writer(folder: Path) -> str | None:
    """The writer in the folder: "process 12 on host, since ..."; None if nobody does, or without locks."""
    path = folder / FILE
    if not is_there(path, folder):  # a pipe would be waited for
        return None
    with suppress(FileNotFoundError, PermissionError), to_read(path, folder) as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return _holder(path)
        except OSError:  # a file system without locks
            return None
    return None


def _hold(descriptor: int, path: Path) -> None:
    end = time.monotonic() + _PATIENCE
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        except BlockingIOError:  # for a moment also where somebody only looks who writes
            if time.monotonic() > end:
                raise UsageError(
                    f"{path.parent} is written by {_holder(path)}; wait until it has ended, or take another folder"
                ) from None
            time.sleep(_PATIENCE / 20)
        except OSError:  # a file system without locks, as some of clusters: then there is none
            return
    since = datetime.now(UTC).isoformat(timespec="seconds")
    os.ftruncate(descriptor, 0)
    os.write(descriptor, f"process {os.getpid()} on {socket.gethostname()}, since {since}\n".encode())


def _holder(path: Path) -> str:
    with suppress(OSError, UsageError):
        if text := one_line(read(path, path.parent).decode(errors="replace")):
            return text
    return "another process"
