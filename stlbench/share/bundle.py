"""A bundle: a folder of results as one zip, an RO-Crate 1.2, whose metadata list every file with its checksum."""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from stlbench import __version__
from stlbench.errors import UsageError, one_line
from stlbench.records import stored
from stlbench.records.inputs import is_there, names, read
from stlbench.records.lines import text_of
from stlbench.records.outputs import LINES, POLICIES, TRACES, cell_files, opened
from stlbench.records.result import Result
from stlbench.study.results import Results

CITATION = "CITATION.cff"
_TABLES = (".csv", ".md", ".html")
"""Files of a folder of results that `stlbench report` writes, and that go into the bundle."""
_ARRAYS = (POLICIES, TRACES)  # its folders of arrays
_EPOCH = (1980, 1, 1, 0, 0, 0)  # the date of every file in a bundle, so that equal results give equal bundles


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
    if target.suffix != ".zip":
        raise UsageError(f"a bundle is a zip, and its name ends in .zip; got {target}")
    results = Results.load(folder)
    if not len(results):
        raise UsageError(f"{folder} holds no result yet")
    kept = [result for result in results if is_there(cell_files(folder, result.id, result.key).policies, folder)]
    listed = dict[str, Content]()
    with opened(target) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for path, data in _contents(folder, results, kept, about, traces):
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
    folder: Path, results: Results, kept: list[Result], about: About, traces: bool
) -> Iterator[tuple[str, bytes]]:
    yield LINES, text_of(results, stored.missing(folder)).encode()
    paths = [folder / name for name in names(folder, folder, _TABLES)]
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
    """What a bundle says of itself."""

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
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise UsageError(f"{METADATA} is not that of a bundle of stlbench: {type(error).__name__} {error}") from error
    title, description, date = (one_line(root.get(name, "")) for name in ("name", "description", "datePublished"))
    return Metadata(About(title, description, authors, one_line(license), date), files)
