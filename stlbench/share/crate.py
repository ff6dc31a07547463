"""What a bundle says of itself: the metadata of an RO-Crate 1.2, with size and checksum of every file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from stlbench.errors import UsageError, one_line

METADATA = "ro-crate-metadata.json"
"""The file that says all this, the only one that is not in its own list."""
_VERSION = "https://w3id.org/ro/crate/1.2"
_SOFTWARE = "#stlbench"


@dataclass(frozen=True)
class About:
    """What people say of a bundle."""

    title: str
    description: str
    authors: tuple[str, ...]
    license: str
    """Its SPDX identifier, such as CC-BY-4.0."""
    date: str
    """When it was packed, as 2026-01-31."""


class Content(NamedTuple):
    """What a file has to hold."""

    sha256: str
    size: int
    """Bytes."""


def document(about: About, files: Mapping[str, Content], version: str) -> str:
    """The metadata as JSON-LD.

    Args:
        about: what people say.
        files: by path inside the bundle.
        version: of stlbench.
    """
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
    entries = [itself, root, *authors, software, *(_entry(path, files[path]) for path in sorted(files))]
    return json.dumps({"@context": f"{_VERSION}/context", "@graph": entries}, indent=1, ensure_ascii=False) + "\n"


def _entry(path: str, content: Content) -> dict[str, str]:
    return {"@id": path, "@type": "File", "sha256": content.sha256, "contentSize": str(content.size)}


def listed(text: str) -> dict[str, Content]:
    """The files that metadata list, by path. Raises `UsageError` where these are no metadata of a bundle."""
    try:
        graph: list[dict[str, Any]] = json.loads(text)["@graph"]
        files = [entry for entry in graph if entry["@type"] == "File"]
        return {str(entry["@id"]): Content(str(entry["sha256"]), int(entry["contentSize"])) for entry in files}
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise UsageError(f"{METADATA} is not that of a bundle of stlbench: {type(error).__name__} {error}") from error


def about(text: str) -> About:
    """What people say of a bundle, from its metadata: each in one line, and empty where they say nothing.

    Raises `UsageError` where these are no metadata of a bundle.
    """
    try:
        entries: dict[str, dict[str, Any]] = {str(entry["@id"]): entry for entry in json.loads(text)["@graph"]}
        root = entries["./"]
        authors = [entries[str(author["@id"])].get("name", "") for author in root.get("author", [])]
        license = str(root.get("license", {}).get("@id", "")).rpartition("/")[2]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise UsageError(f"{METADATA} is not that of a bundle of stlbench: {type(error).__name__} {error}") from error
    texts = (root.get("name", ""), root.get("description", ""), license, root.get("datePublished", ""))
    title, description, license, date = map(one_line, texts)
    return About(title, description, tuple(map(one_line, authors)), license, date)
