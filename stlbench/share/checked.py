"""Check a bundle: names, sizes, checksums, results and policies, on any machine and without its plugins."""

from __future__ import annotations

import hashlib
import re
import stat
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import NamedTuple

from stlbench.errors import UsageError, one_line
from stlbench.records import npz, saved_policies, stored
from stlbench.records.outputs import LINES, cell_files
from stlbench.records.result import Result
from stlbench.share.bundle import METADATA, Content, may_hold, read_metadata
from stlbench.study.results import Results

LARGEST = 8 * 2**30  # the most bytes of a bundle unpacked: a larger zip may be an attack that fills the disk
LARGEST_POLICIES = 2**28  # the most bytes of a cell's policies in memory: their file is a zip inside the zip
_LIST = 2**26  # the most bytes of the metadata
_PIECE = 2**20
_KEY = re.compile(r"[0-9a-f]{1,64}")
_DAMAGED = (OSError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, UnicodeError)
"""Exceptions of `zipfile` for damaged, encrypted or unknown content."""


class Checked(NamedTuple):
    cells: int  # 0 if its results cannot be read
    policies: int  # cells that have policies in the bundle
    problems: tuple[str, ...]  # one line each; none if the bundle is whole


def check(path: Path) -> Checked:
    """Check a bundle. Raises `UsageError` if the file is none."""
    with unpacked(path) as (folder, problems):
        wrong = list(problems)
        if problems and not (folder / LINES).is_file():
            return Checked(0, 0, problems)
        try:
            results = tuple(results_in(folder))
        except UsageError as error:
            return Checked(0, 0, (*wrong, _inside(error, folder)))
        wrong += [f"{result.id.name}: its key is none" for result in results if not _KEY.fullmatch(result.key)]
        kept = [result for result in results if _KEY.fullmatch(result.key) and _file(folder, result).is_file()]
        for result in kept:
            wrong += _policies(folder, result)
        return Checked(len(results), len(kept), tuple(wrong))


def results_in(folder: Path) -> Results:
    """The results of an unpacked bundle, from its lines alone: a ledger might name code of this machine.

    Raises `UsageError` as `stored.read`.
    """
    return Results.of(stored.read(folder / LINES), folder)


def _file(folder: Path, result: Result) -> Path:
    return cell_files(folder, result.id, result.key).policies


def _policies(folder: Path, result: Result) -> Iterator[str]:
    try:
        if npz.size_as_floats(_file(folder, result)) > LARGEST_POLICIES:
            yield f"{result.id.name}: its policies would be more than {LARGEST_POLICIES >> 20} MiB in memory"
            return
        for which in ("selected", "final"):
            saved_policies.read(folder, result, which)
    except (UsageError, ValueError) as error:
        yield _inside(error, folder)


def _inside(error: ValueError, folder: Path) -> str:
    """The paths of a message as they are inside the bundle."""
    return one_line(str(error).replace(f"{folder}/", ""))


@contextmanager
def unpacked(path: Path) -> Iterator[tuple[Path, tuple[str, ...]]]:
    """A bundle's files in a temporary folder, and what is wrong with them, a line each.

    A file is unpacked only if the bundle lists it, a bundle may hold it, it is no link, and its path stays inside the
    folder. Raises `UsageError` if the file is no bundle, or is larger than `LARGEST`.
    """
    try:
        with zipfile.ZipFile(path) as archive, tempfile.TemporaryDirectory(prefix="stlbench-") as name:
            problems = tuple(map(one_line, _unpack(archive, Path(name))))
            yield Path(name), problems
    except _DAMAGED as error:
        raise UsageError(f"{path} is no bundle that `stlbench bundle` wrote: {error}") from error


def _unpack(archive: zipfile.ZipFile, folder: Path) -> Iterator[str]:
    members = {info.filename: info for info in archive.infolist()}
    if METADATA not in members:
        raise UsageError(f"{archive.filename} is no bundle: it has no {METADATA}")
    if sum(info.file_size for info in archive.infolist()) > LARGEST or members[METADATA].file_size > _LIST:
        raise UsageError(f"{archive.filename} would be more than {LARGEST >> 20} MiB unpacked, or its list of files is")
    text = archive.read(METADATA)
    (folder / METADATA).write_bytes(text)
    wanted = read_metadata(text.decode()).files
    if len(members) < len(archive.infolist()):
        yield "a name is in the zip more than once"
    yield from (f"{name}: not in the list of {METADATA}" for name in sorted(members.keys() - wanted - {METADATA}))
    for name, content in sorted(wanted.items()):
        if name not in members:
            yield f"{name}: missing"
        elif not _stays_inside(name):
            yield f"{name}: not a path inside the bundle"
        elif not may_hold(name):
            yield f"{name}: no file of a bundle"
        elif stat.S_ISLNK(members[name].external_attr >> 16):
            yield f"{name}: a link, and no bundle has links"
        elif problem := _extract(archive, members[name], content, folder / name):
            yield f"{name}: {problem}"


def _stays_inside(name: str) -> bool:
    path = PurePosixPath(name)
    return not (path.is_absolute() or ".." in path.parts or "\\" in name or ":" in name or "\0" in name)


def _extract(archive: zipfile.ZipFile, member: zipfile.ZipInfo, content: Content, target: Path) -> str:
    """Write a file, or say what is wrong with it."""
    if member.file_size != content.size:
        return f"{member.file_size} bytes, and {METADATA} says {content.size}"
    digest = hashlib.sha256()
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with archive.open(member) as source, target.open("wb") as copy:
            while piece := source.read(_PIECE):
                digest.update(piece)
                copy.write(piece)
    except _DAMAGED as error:
        target.unlink(missing_ok=True)
        return f"damaged: {error}"
    if digest.hexdigest() == content.sha256:
        return ""
    target.unlink()
    return "its content is another than when it was packed"
