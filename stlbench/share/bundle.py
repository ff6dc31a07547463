"""A bundle: a folder of results as one zip, an RO-Crate 1.2, whose metadata list every file with its checksum; made,
and checked on any machine without its plugins.
"""

from __future__ import annotations

import hashlib
import json
import re
import stat
import tempfile
import unicodedata
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import yaml

from stlbench import __version__
from stlbench.errors import UsageError, one_line, unwritable
from stlbench.records import array_files, results_folder
from stlbench.records.lines import text_of
from stlbench.records.result import Result
from stlbench.records.result_files import LINES, POLICIES, TRACES, cell_files, is_there, names, opened, read, write
from stlbench.report import Report
from stlbench.report.page import FILE as PAGE
from stlbench.study.results import Results

CITATION = "CITATION.cff"
_TABLES = (".csv", ".md", ".html")  # how the names of tables in a bundle end
_ARRAYS = (POLICIES, TRACES)  # its folders of arrays
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the date of every file in a bundle, so that equal results give equal bundles


NAME = re.compile(r"[A-Za-z0-9._+-]+")
"""The names that bundles have before `.zip`, as in a report they are parameters of methods."""
NAMES = "letters, digits and . _ + -"  # the same in words


def name_for(folder: str) -> str:
    """The name of a bundle of a folder: the folder's own, without accents, and - for what `NAME` does not have."""
    plain = unicodedata.normalize("NFKD", folder).encode("ascii", "ignore").decode()
    return "-".join(NAME.findall(plain)) or "results"


class Packed(NamedTuple):
    cells: int
    policies: int  # cells whose policies are in it
    files: int
    size: int  # bytes of the bundle


def pack(folder: Path, target: Path, about: About, traces: bool = False) -> Packed:
    """Write a bundle, in place of an older one; with the traces only if asked, since they are large.

    It has `cells.jsonl`, the whole record of each cell; the tables and the page of the last `stlbench report`;
    `policies/`; a citation file if there are authors. Unzipped it is a folder of results again. Raises `UsageError`.
    """
    if target.suffix != ".zip" or not NAME.fullmatch(target.stem):
        raise UsageError(f"a bundle is a zip, and its name ends in .zip, after {NAMES}; got {target}")
    results = Results.load(folder)
    if not len(results):
        raise UsageError(f"{folder} holds no result yet")
    lines, folder = text_of(results, results_folder.missing(folder)), results.folder
    kept = [result for result in results if is_there(cell_files(folder, result.id, result.key).policies, folder)]
    listed = dict[str, Content]()
    with opened(target) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in _contents(results, lines, kept, about, traces):
            listed[path] = Content(hashlib.sha256(data).hexdigest(), len(data))
            _write(archive, path, data)
        _write(archive, METADATA, document(about, listed, __version__).encode())
    return Packed(len(results), len(kept), len(listed), target.stat().st_size)


def may_hold(path: str) -> bool:
    """Whether `pack` may write a file of this path, apart from the metadata: no ledger, no code."""
    *folder, name = path.split("/")
    if not folder:
        return name in (LINES, CITATION) or name.endswith(_TABLES)
    return len(folder) == 1 and folder[0] in _ARRAYS and name.endswith(".npz")


def _write(archive: zipfile.ZipFile, path: str, data: bytes) -> None:
    archive.writestr(zipfile.ZipInfo(path, _EPOCH), data, zipfile.ZIP_DEFLATED)


def _contents(
    results: Results, lines: str, kept: list[Result], about: About, traces: bool
) -> Iterator[tuple[str, bytes]]:
    folder = results.folder
    yield LINES, lines.encode()
    tables = {"report.md", PAGE, *(f"{name}.csv" for name in Report((), {}).tables)}
    paths = [folder / name for name in names(folder, folder, _TABLES) if name in tables]
    paths += [cell_files(folder, result.id, result.key).policies for result in kept]
    paths += [cell_files(folder, result.id, result.key).traces for result in results if traces]
    for path in paths:
        if is_there(path, folder):
            yield path.relative_to(folder).as_posix(), read(path, folder)
    if about.authors:
        yield CITATION, _citation(about).encode()


def _citation(about: About) -> str:
    """A file of the Citation File Format 1.2."""
    stlbench = {"type": "software", "title": "stlbench", "version": __version__}
    content = {
        "cff-version": "1.2.0",
        "message": "Please cite these results, and stlbench, which made them.",
        "type": "dataset",
        "title": about.title,
        "license": about.license,
        "date-released": about.date,
        "authors": [{"name": name} for name in about.authors],
        "references": [stlbench | {"authors": [{"name": "The stlbench maintainers"}]}],
    }
    return str(yaml.safe_dump(content, sort_keys=False, allow_unicode=True))


METADATA = "ro-crate-metadata.json"  # the metadata, the only file that they do not list
_VERSION = "https://w3id.org/ro/crate/1.2"
_SOFTWARE = "#stlbench"


@dataclass(frozen=True)
class About:
    title: str
    description: str
    authors: tuple[str, ...]
    license: str  # its SPDX identifier, such as CC-BY-4.0
    date: str  # when it was packed, as 2026-01-31


class Content(NamedTuple):
    sha256: str
    size: int  # bytes


def document(about: About, files: Mapping[str, Content], version: str) -> str:
    """The metadata as JSON-LD, with `files` by their paths inside the bundle, and the version of stlbench."""
    authors = [
        {"@id": f"#author-{number}", "@type": "Person", "name": name} for number, name in enumerate(about.authors)
    ]
    root = {
        "@id": "./",
        "@type": "Dataset",
        "name": about.title,
        "description": about.description,
        "datePublished": about.date,
        "license": {"@id": f"https://spdx.org/licenses/{about.license}"},
        "author": [{"@id": author["@id"]} for author in authors],
        "hasPart": [{"@id": path} for path in sorted(files)],
        "mentions": {"@id": _SOFTWARE},
    }
    itself = {
        "@id": METADATA,
        "@type": "CreativeWork",
        "conformsTo": {"@id": _VERSION},
        "about": {"@id": "./"},
    }
    software = {"@id": _SOFTWARE, "@type": "SoftwareApplication", "name": "stlbench", "version": version}
    entries = [itself, root, *authors, software]
    for path, content in sorted(files.items()):
        size = str(content.size)
        entries.append({"@id": path, "@type": "File", "sha256": content.sha256, "contentSize": size})
    return json.dumps({"@context": f"{_VERSION}/context", "@graph": entries}, indent=1, ensure_ascii=False) + "\n"


class Metadata(NamedTuple):
    """The facts that a bundle states."""

    about: About
    files: Mapping[str, Content]  # by path


def read_metadata(text: str) -> Metadata:
    """The metadata of a bundle; each text is one line. Raises `UsageError` if these are none."""
    try:
        entries: dict[str, dict[str, Any]] = {str(entry["@id"]): entry for entry in json.loads(text)["@graph"]}
        files = {
            path: Content(str(entry["sha256"]), int(entry["contentSize"]))
            for path, entry in entries.items()
            if entry["@type"] == "File"
        }
        root = entries["./"]
        authors = tuple(one_line(entries[str(author["@id"])].get("name", "")) for author in root.get("author", []))
        license = str(root.get("license", {}).get("@id", "")).rpartition("/")[2]
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise UsageError(f"{METADATA} is not that of a bundle of stlbench: {type(error).__name__} {error}") from error
    title, description, date = (one_line(root.get(name, "")) for name in ("name", "description", "datePublished"))
    return Metadata(About(title, description, authors, one_line(license), date), files)


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

    Raises `UsageError` as `results_folder.read`.
    """
    lines = folder / LINES
    return Results.of(results_folder.read(lines), folder, results_folder.missing(lines).values())


def _file(folder: Path, result: Result) -> Path:
    return cell_files(folder, result.id, result.key).policies


def _policies(folder: Path, result: Result) -> Iterator[str]:
    try:
        if array_files.size_as_floats(_file(folder, result)) > LARGEST_POLICIES:
            yield f"{result.id.name}: its policies would be more than {LARGEST_POLICIES >> 20} MiB in memory"
            return
        array_files.check_policies(folder, result)
    except ValueError as error:
        yield _inside(error, folder)


def _inside(error: ValueError, folder: Path) -> str:
    """The paths of a message as they are inside the bundle."""
    return one_line(str(error).replace(f"{folder}/", ""))


@contextmanager
def unpacked(path: Path) -> Iterator[tuple[Path, tuple[str, ...]]]:
    """A bundle's files in a temporary folder, and what is wrong with them, a line each.

    A file is unpacked only if the bundle lists it, a bundle may hold it, it is no link, and its path stays inside the
    folder. Raises `UsageError` if the file is no bundle, or is larger than `LARGEST`, or the folder cannot take it.
    """
    try:
        with zipfile.ZipFile(path) as archive, _temporary() as name:
            problems = tuple(map(one_line, _unpack(archive, Path(name))))
            yield Path(name), problems
    except _DAMAGED as error:
        raise UsageError(f"{path} is no bundle that `stlbench bundle` wrote: {error}") from error


def _temporary() -> tempfile.TemporaryDirectory[str]:
    try:
        return tempfile.TemporaryDirectory(prefix="stlbench-")
    except OSError as error:
        raise unwritable("cannot make a temporary folder", error) from error


def _unpack(archive: zipfile.ZipFile, folder: Path) -> Iterator[str]:
    members = {info.filename: info for info in archive.infolist()}
    if METADATA not in members:
        raise UsageError(f"{archive.filename} is no bundle: it has no {METADATA}")
    if sum(info.file_size for info in archive.infolist()) > LARGEST or members[METADATA].file_size > _LIST:
        raise UsageError(f"{archive.filename} would be more than {LARGEST >> 20} MiB unpacked, or its list of files is")
    text = archive.read(METADATA)
    write(folder / METADATA, text)
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


class _Damaged(Exception):
    pass


def _pieces(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> Iterator[bytes]:
    """The content of a file. Raises `_Damaged`, which no error of the file that it is written to is."""
    try:
        with archive.open(member) as source:
            while piece := source.read(_PIECE):
                yield piece
    except _DAMAGED as error:
        raise _Damaged(error) from error


def _extract(archive: zipfile.ZipFile, member: zipfile.ZipInfo, content: Content, target: Path) -> str:
    """Write a file, or say what is wrong with it. Raises `UsageError` where it cannot be written."""
    if member.file_size != content.size:
        return f"{member.file_size} bytes, and {METADATA} says {content.size}"
    digest = hashlib.sha256()
    try:
        with opened(target) as copy:
            for piece in _pieces(archive, member):
                digest.update(piece)
                copy.write(piece)
    except _Damaged as error:
        return f"damaged: {error}"
    if digest.hexdigest() == content.sha256:
        return ""
    target.unlink()
    return "its content is another than when it was packed"
