"""The files of a folder of results: where those of a cell are, how one is replaced as a whole, how one of a stranger
is read, and the lock of a run that writes.

A folder of results may come from a stranger. A link in it would lead what is written to any file of the user, and would
have any file's content shown or packed. A pipe would be waited for. So none of them is written through or read. The
folder itself may be a link.
"""

import csv
import fcntl
import io
import os
import re
import socket
import stat
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

from stlbench.errors import UsageError, one_line, printable, unwritable
from stlbench.records.identity import CellId


def inside(path: Path, folder: Path, purpose: Literal["write", "read"] = "write") -> Path:
    """The same path, after a look at each of its parts below the folder; the folder itself may be a link.

    Raises:
        UsageError: a part is a link, or the path leaves the folder, or what is there is a pipe or a device.
    """
    above, parts, here, mode = folder.parts, path.parts, str(folder), stat.S_IFDIR
    if parts[: len(above)] != above or ".." in parts[len(above) :]:
        raise UsageError(f"{path} is not inside {folder}")
    try:
        for part in parts[len(above) :]:
            here = os.path.join(here, part)
            mode = os.lstat(here).st_mode
            if stat.S_ISLNK(mode):
                way = "remove it, or take another folder"
                raise UsageError(f"{here} is a link, and stlbench {purpose}s through none; {way}")
    except (FileNotFoundError, NotADirectoryError):
        return path
    except ValueError as error:
        raise error if isinstance(error, UsageError) else UsageError(f"{one_line(path)}: {error}") from error
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise UsageError(f"cannot {purpose} {path}: it is neither a file nor a folder")
    return path


def write(path: Path, content: str | bytes, folder: Path | None = None) -> Path:
    """Write a file, text as UTF-8; its path. Arguments and errors as for `opened`."""
    with opened(path, folder) as file:
        file.write(content.encode() if isinstance(content, str) else content)
    return path


@contextmanager
def opened(path: Path, folder: Path | None = None) -> Iterator[BinaryIO]:
    """Open a file to write. It replaces an earlier one when all is written; if writing fails, the old one stays.

    Folders above it are made. No part of the path below `folder`, which is the file's own by default, may be a link.
    Raises `UsageError` as `inside`, or if the file cannot be written; `DiskFull` if there is no space for it.
    """
    inside(path, folder or path.parent)
    if not path.name:
        raise UsageError(f"cannot write {path}: it is a folder")
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        part.unlink(missing_ok=True)
        try:
            with open(part, "xb", opener=_without_links) as file:
                yield file
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise unwritable(f"cannot write {path}", error) from error


@contextmanager
def appended(path: Path, folder: Path) -> Iterator[BinaryIO]:
    """Open a file of a folder to read it and to write at its end; it is made if it is missing, and on disk at the end.

    Raises `UsageError` as `opened`, and if there is no file but something else.
    """
    flags = os.O_RDWR | os.O_CREAT | os.O_NONBLOCK  # a pipe that has just taken the place is not waited for
    try:
        inside(path, folder).parent.mkdir(parents=True, exist_ok=True)
        with open(_without_links(str(path), flags), "r+b") as file:
            if not stat.S_ISREG(os.fstat(file.fileno()).st_mode):
                raise UsageError(f"cannot write {path}: it is no file")
            yield file
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        raise unwritable(f"cannot write {path}", error) from error


def _without_links(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOFOLLOW | getattr(os, "O_CLOEXEC", 0), 0o666)


_FORMULA = re.compile(r"(?![+-]?[0-9.]+(e[+-]?[0-9]+)?\Z)[=+\-@\t\r\n＝＋－＠]\W*\w", re.IGNORECASE)  # noqa: RUF001
"""How a text begins that a spreadsheet would compute, some also by wide signs. Neither a number nor a mark such as =
is one."""


def csv_value(value: object) -> object:
    """A value for CSV: a text that a spreadsheet would compute has an apostrophe before it; a number is as it is."""
    return f"'{value}" if isinstance(value, str) and _FORMULA.match(value) else value


def csv_text(rows: Iterable[Iterable[object]]) -> str:
    """Rows as CSV; None is an empty field."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(map(csv_value, row) for row in rows)
    return text.getvalue()


LINES = "cells.jsonl"
"""Name of the file in a folder of results that gets a line of JSON as each cell ends (`lines`). Without a ledger, the
results are read from there."""
PACKED = LINES + ".xz"  # what `stlbench export` writes of them, for git
TRACES, POLICIES, LOGS = "traces", "policies", "logs"  # names of the folders in a folder of results
TRAININGS = "trainings"  # of those from which another training goes on


class CellFiles(NamedTuple):
    traces: Path  # see `array_files.save_traces`
    policies: Path  # see `array_files.save_policies`
    log: Path  # what the cell wrote to standard output and error
    training: Path  # see `array_files.save_training`


def cell_files(folder: Path, cell: CellId, key: str) -> CellFiles:
    """The paths in a folder of results. Names consist of the cell and the beginning of its key."""
    name = cell.name.replace("/", "_") + end_of_name(key)
    log = (folder / LOGS / name).with_suffix(".log")
    return CellFiles(folder / TRACES / name, folder / POLICIES / name, log, folder / TRAININGS / name)


def discard_arrays(folder: Path, cell: CellId, key: str) -> None:
    """Remove what a cell saved that has no result. A link is left alone."""
    files = cell_files(folder, cell, key)
    for file in (files.traces, files.policies, files.training):
        if is_there(file, folder):
            file.unlink()


def end_of_name(key: str) -> str:
    """How the names of the arrays of a result end. The key of a stranger's result may look like a path."""
    return f"_{key[:12]}.npz".replace("/", "_")


def followed(path: Path) -> Path:
    """A file that the user names; where it is a link, what it leads to."""
    return Path(os.path.realpath(path)) if path.is_symlink() else path


def is_there(path: Path, folder: Path) -> bool:
    """Whether a file is there that `to_read` opens."""
    try:
        return stat.S_ISREG(os.lstat(inside(path, folder, "read")).st_mode)
    except (FileNotFoundError, NotADirectoryError, UsageError):
        return False


def to_read(path: Path, folder: Path) -> BinaryIO:
    """Open a file.

    Raises `UsageError` if a part of the path below the folder is a link, or what is there is no file; `OSError` if
    nothing is there, or it cannot be opened.
    """
    return open(inside(path, folder, "read"), "rb", opener=_file_alone)


def _file_alone(path: str, flags: int) -> int:
    """Opens what may have taken the place of the file since the look at it; that is not waited for."""
    descriptor = os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK | getattr(os, "O_CLOEXEC", 0))
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise UsageError(f"cannot read {path}: it is no file")
    return descriptor


def read(path: Path, folder: Path) -> bytes:
    """The content of a file. Raises as `to_read`."""
    with to_read(path, folder) as file:
        return file.read()


def names(path: Path, folder: Path, end: str | tuple[str, ...]) -> list[str]:
    """The names in a folder that end so, in order; none where the folder is missing or a link leads to it."""
    try:
        return sorted(name for name in os.listdir(inside(path, folder, "read")) if name.endswith(end))
    except (FileNotFoundError, NotADirectoryError, UsageError):
        return []


def end_of_log(log: Path, folder: Path, lines: int = 20) -> list[str]:
    """The last lines of a log, safe to show; none where there is no log."""
    try:
        with to_read(log, folder) as file:
            file.seek(max(0, os.fstat(file.fileno()).st_size - 100 * lines))
            text = file.read().decode(errors="backslashreplace")
    except (OSError, UsageError):
        return []
    return printable(text).splitlines()[-lines:]


_LOCK = ".lock"  # its name in a folder of results. It stays there; what counts is whether a process holds it.
_PATIENCE = 0.5  # seconds for which a lock is tried


@contextmanager
def writing(folder: Path) -> Iterator[None]:
    """Hold the lock of a folder of results, which is made if it is missing.

    Raises `UsageError` if another process holds it, with its name, or if the folder cannot be written.
    """
    path = folder / _LOCK
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
    path = folder / _LOCK
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
