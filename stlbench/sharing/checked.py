"""Is a bundle what it says? Names, sizes, checksums, results, policies, on any machine and without its plugins."""

from __future__ import annotations

import hashlib
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from stlbench.errors import UsageError
from stlbench.result import Result
from stlbench.rollout import saved_policies
from stlbench.sharing.crate import METADATA, Content, listed
from stlbench.study.results import Results

__all__ = ["LARGEST", "Checked", "check", "unpacked"]

LARGEST = 8 * 2**30
"""Bytes that a bundle may have unpacked. More is taken for a zip that was made to fill a disk."""
_PIECE = 2**20
_DAMAGED = (OSError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, UnicodeError)
"""What `zipfile` raises on damaged, encrypted or unknown content."""


class Checked(NamedTuple):
    """What was found."""

    cells: int
    policies: int
    """Cells that have policies in the bundle."""
    problems: tuple[str, ...]
    """One line each; none where all is as the bundle says."""


def check(path: Path) -> Checked:
    """Check a bundle. Raises `UsageError` where it is none at all."""
    with unpacked(path) as (folder, problems):
        found = list(problems)
        try:
            results = tuple(Results.load(folder))
        except UsageError as error:
            return Checked(0, 0, (*found, _inside(error, folder)))
        kept = [result for result in results if _file(folder, result).is_file()]
        for result in kept:
            found += _policies(folder, result)
        return Checked(len(results), len(kept), tuple(found))


def _file(folder: Path, result: Result) -> Path:
    return saved_policies.policy_file(folder, result.id, result.key)


def _policies(folder: Path, result: Result) -> Iterator[str]:
    """Where the stored policies of a cell are not those that its result is of."""
    for which in ("selected", "final"):
        try:
            saved_policies.read(folder, result, which)
        except UsageError as error:
            yield _inside(error, folder)
            return


def _inside(error: UsageError, folder: Path) -> str:
    """The paths of a message as they are inside the bundle."""
    return str(error).replace(f"{folder}/", "")


@contextmanager
def unpacked(path: Path) -> Iterator[tuple[Path, tuple[str, ...]]]:
    """A bundle's files in a folder that is gone afterwards, and what is wrong with them.

    Only what the bundle lists is unpacked, and only under names that stay inside the folder.

    Raises:
        UsageError: the file is no zip, or has no metadata of a bundle.
    """
    try:
        with zipfile.ZipFile(path) as archive, tempfile.TemporaryDirectory(prefix="stlbench-") as name:
            yield Path(name), tuple(_unpack(archive, Path(name)))
    except _DAMAGED as error:
        raise UsageError(f"{path} is no bundle that `stlbench bundle` wrote: {error}") from error


def _unpack(archive: zipfile.ZipFile, folder: Path) -> Iterator[str]:
    members = {info.filename: info for info in archive.infolist()}
    if METADATA not in members:
        raise UsageError(f"{archive.filename} is no bundle: it has no {METADATA}")
    if sum(info.file_size for info in members.values()) > LARGEST:
        raise UsageError(f"{archive.filename} would be more than {LARGEST >> 30} GiB unpacked")
    wanted = listed(archive.read(METADATA).decode())
    if len(members) < len(archive.infolist()):
        yield "a name is in the zip more than once"
    yield from (f"{name}: not in the list of {METADATA}" for name in sorted(members.keys() - wanted - {METADATA}))
    for name, content in sorted(wanted.items()):
        if name not in members:
            yield f"{name}: missing"
        elif not _stays_inside(name):
            yield f"{name}: not a path inside the bundle"
        elif problem := _extract(archive, members[name], content, folder / name):
            yield f"{name}: {problem}"


def _stays_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return not (path.is_absolute() or ".." in path.parts or "\\" in name or ":" in name or "\0" in name)


def _extract(archive: zipfile.ZipFile, member: zipfile.ZipInfo, content: Content, target: Path) -> str:
    """Write a file if it is as it should be; else what is wrong."""
    if member.file_size != content.size:
        return f"{member.file_size} bytes, and {METADATA} says {content.size}"
    target.parent.mkdir(parents=True, exist_ok=True)
    found = hashlib.sha256()
    try:
        with archive.open(member) as source, target.open("wb") as copy:
            while piece := source.read(_PIECE):
                found.update(piece)
                copy.write(piece)
    except _DAMAGED as error:
        target.unlink(missing_ok=True)
        return f"damaged: {error}"
    if found.hexdigest() == content.sha256:
        return ""
    target.unlink()
    return "its content is another than when it was packed"
