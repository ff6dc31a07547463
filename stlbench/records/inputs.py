"""The files of a folder that a user names, to read. It may come from a stranger.

A link in it would lead to any file of the user, whose content would be shown or packed. A pipe would be waited for. So
none of them is read. The folder itself may be a link.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path
from typing import BinaryIO

from stlbench.errors import UsageError, printable
from stlbench.records.outputs import inside


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
