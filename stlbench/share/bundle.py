"""A folder of results packed into one file: results, tables, policies, and a list of all of it with checksums."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from stlbench import __version__
from stlbench.errors import UsageError
from stlbench.records import stored
from stlbench.records.cell_files import POLICIES, TRACES, cell_files
from stlbench.records.outputs import opened
from stlbench.records.result import Result
from stlbench.share.crate import METADATA, About, Content, document
from stlbench.study.results import Results

CITATION = "CITATION.cff"
_TABLES = (".csv", ".md", ".html")
"""Files of a folder of results that `stlbench report` writes, and that a bundle takes along."""
_ARRAYS = (POLICIES, TRACES)
"""Its folders, which have files of arrays and nothing else."""
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""The date of every file inside, so that equal results give equal bundles."""


class Packed(NamedTuple):
    """What went into a bundle."""

    cells: int
    policies: int
    """Cells whose policies are in it."""
    files: int
    size: int
    """Bytes of the bundle."""


def pack(folder: Path, target: Path, about: About, traces: bool = False) -> Packed:
    """Write a bundle, over the file of before: a zip that is an RO-Crate.

    It has `cells.jsonl`, all that is recorded of each cell and its provenance; the tables and the page of the last
    `stlbench report`; `policies/`; a citation file where there are authors. Unzipped it is a folder of results again.

    Args:
        folder: of results.
        target: the file, whose name ends in .zip.
        about: what its metadata say.
        traces: whether `traces/` comes along, most of the size where it does.

    Raises:
        UsageError: there are no results, or a file cannot be read or written.
    """
    if target.suffix != ".zip":
        raise UsageError(f"a bundle is a zip, and its name ends in .zip; got {target}")
    results = Results.load(folder)
    if not len(results):
        raise UsageError(f"{folder} holds no result yet")
    kept = [result for result in results if cell_files(folder, result.id, result.key).policies.is_file()]
    listed = dict[str, Content]()
    with opened(target) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in _contents(folder, results, kept, about, traces):
            listed[path] = Content(hashlib.sha256(data).hexdigest(), len(data))
            _write(archive, path, data)
        _write(archive, METADATA, document(about, listed, __version__).encode())
    return Packed(len(results), len(kept), len(listed), target.stat().st_size)


def may_hold(path: str) -> bool:
    """Whether a path inside a bundle is one that `pack` writes, but for the metadata: no ledger, no code."""
    *folder, name = path.split("/")
    if not folder:
        return name in (stored.LINES, CITATION) or name.endswith(_TABLES)
    return len(folder) == 1 and folder[0] in _ARRAYS and name.endswith(".npz")


def _write(archive: zipfile.ZipFile, path: str, data: bytes) -> None:
    archive.writestr(zipfile.ZipInfo(path, _EPOCH), data, zipfile.ZIP_DEFLATED)


def _contents(
    folder: Path, results: Results, kept: list[Result], about: About, traces: bool
) -> Iterator[tuple[str, bytes]]:
    """Paths inside the bundle, in the order of their names as far as they are of a kind, and what they hold."""
    yield stored.LINES, stored.lines(results, stored.missing_by_key(folder)).encode()
    for path in sorted(path for path in folder.iterdir() if path.suffix in _TABLES and path.is_file()):
        yield path.name, path.read_bytes()
    for result in kept:
        path = cell_files(folder, result.id, result.key).policies
        yield path.relative_to(folder).as_posix(), path.read_bytes()
    for result in results if traces else ():
        path = cell_files(folder, result.id, result.key).traces
        if path.is_file():
            yield path.relative_to(folder).as_posix(), path.read_bytes()
    if about.authors:
        yield CITATION, _citation(about).encode()


def _citation(about: About) -> str:
    """A file of the Citation File Format 1.2; JSON is YAML, and quotes whatever a title has."""
    quoted = json.dumps
    text = io.StringIO()
    text.write(f"cff-version: 1.2.0\nmessage: {quoted('Please cite these results, and stlbench, which made them.')}\n")
    text.write(f"type: dataset\ntitle: {quoted(about.title)}\nlicense: {quoted(about.license)}\n")
    text.write(f"date-released: {quoted(about.date)}\nauthors:\n")
    text.writelines(f"  - name: {quoted(name)}\n" for name in about.authors)
    text.write(f"references:\n  - type: software\n    title: stlbench\n    version: {quoted(__version__)}\n")
    text.write("    authors:\n      - name: The stlbench maintainers\n")
    return text.getvalue()
