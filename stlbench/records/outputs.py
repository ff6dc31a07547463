"""The files that stlbench writes: each is replaced as a whole, and none is written through a link.

A folder of results may come from a stranger. A link in it would lead what is written to any file of the user.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

from stlbench.errors import UsageError, unwritable


def inside(path: Path, folder: Path) -> Path:
    """The same path, after a look at each of its parts below the folder; the folder itself may be a link.

    Raises:
        UsageError: a part is a link, or the path leaves the folder, or what is there is a pipe or a device.
    """
    parts = path.relative_to(folder).parts
    if ".." in parts:
        raise UsageError(f"{path} is not inside {folder}")
    for count in range(1, len(parts) + 1):
        part = folder.joinpath(*parts[:count])
        if part.is_symlink():
            raise UsageError(f"{part} is a link, and stlbench writes through none; remove it, or take another folder")
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise UsageError(f"cannot write {path}: it is neither a file nor a folder")
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


def _without_links(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NOFOLLOW | getattr(os, "O_CLOEXEC", 0), 0o666)
