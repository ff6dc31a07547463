"""The files that stlbench writes: where those of a cell are, and how a file is replaced as a whole.

None is written through a link. A folder of results may come from a stranger. A link in it would lead what is written to
any file of the user.
"""

from __future__ import annotations

import csv
import io
import os
import re
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, Literal, NamedTuple

from stlbench.errors import UsageError, one_line, unwritable
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
PACKED = LINES + ".gz"  # what `stlbench export` writes of them, for git
TRACES, POLICIES, LOGS = "traces", "policies", "logs"  # names of the folders in a folder of results


class CellFiles(NamedTuple):
    traces: Path  # see `saved_traces`
    policies: Path  # see `saved_policies`
    log: Path  # what the cell wrote to standard output and error


def cell_files(folder: Path, cell: CellId, key: str) -> CellFiles:
    """The paths in a folder of results. Names consist of the cell and the beginning of its key."""
    name = cell.name.replace("/", "_") + end_of_name(key)
    return CellFiles(folder / TRACES / name, folder / POLICIES / name, (folder / LOGS / name).with_suffix(".log"))


def end_of_name(key: str) -> str:
    """How the names of the arrays of a result end. The key of a stranger's result may look like a path."""
    return f"_{key[:12]}.npz".replace("/", "_")
