"""The code behind a module, told apart by digests, so that what is edited in place is seen. Imports nothing of it."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache, reduce
from importlib import metadata, resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import yaml

from stlbench.registry.effective_source import TASK_FILES, effective_digest

_NO_DATA = (".py", ".pyc", ".pyi", ".md", ".rst", ".typed", "~")
"""How names end of files beside modules that are no data."""
_RESULTS = ("ledger.sqlite", "cells.jsonl")  # a folder that has one of these is of results, which a run writes
_INSTALLED = {"site-packages", "dist-packages"}


@dataclass(frozen=True)
class Code:
    """What a module and all that it imports are made of, as far as it can change what they do."""

    files: tuple[tuple[str, str], ...] = ()
    """Name and digest of each module, `pack.one`, and of each file of data beside one, `pack/table.npz`; sorted."""
    packages: tuple[tuple[str, str], ...] = ()
    """Name and version of each installed distribution that is imported; sorted."""

    def __or__(self, other: Code) -> Code:
        files, packages = {*self.files, *other.files}, {*self.packages, *other.packages}
        return Code(tuple(sorted(files)), tuple(sorted(packages)))

    @cached_property
    def digest(self) -> str:
        """Of the files, 32 hex digits. `TASK_FILES` have no part in it: a task's key has what they say."""
        text = [f"{name} {digest}\n" for name, digest in self.files if name.rpartition("/")[2] not in TASK_FILES]
        return hashlib.sha256("".join(text).encode()).hexdigest()[:32]

    @property
    def changed(self) -> str | None:
        """The first file or distribution that is no longer the same; None if all are."""
        for name, digest in self.files:
            path = _path(name)
            if path is None or _digest(path, name) != digest:
                return str(path or name)
        packages = (name for name, version in self.packages if _version(name) != version)
        return next(packages, None)


def fingerprint(module: str) -> str:
    return code_of(module).digest


def code_of(module: str, *, packages: bool = True) -> Code:
    """The code of a module: itself, the packages that it lies in, what these import by name, and so on.

    An installed distribution counts by its version, unless it has the module's own top-level package. Python's own
    modules do not count. Files of data in the folder of a package count, and in folders below it that are no packages:
    all but hidden files, Markdown, and folders of results. Comments, docstrings and the place of files do not count.
    What is imported by a name that is made at run time is not seen.
    """
    own, pending, files, installed = module.partition(".")[0], {module}, dict[str, str](), dict[str, str]()
    seen = set[str]()
    while pending:
        name = pending.pop()
        seen.add(name)
        if name.partition(".")[0] != own and (versions := _versions(name.partition(".")[0], packages)) is not None:
            installed |= versions
            continue
        files |= _data(name)
        imported: tuple[str, ...] = ()
        if (path := _file(name)) is not None:
            files[name], imported = effective_digest(path, name)
        pending |= {*imported, name.rpartition(".")[0]} - {*seen, ""}
    return Code(tuple(sorted(files.items())), tuple(sorted(installed.items())))


def own_code(modules: Iterable[str]) -> Code:
    """The code (`code_of`) of those modules that are the user's own: of no installed distribution, or of one that is
    installed editable, so that its source can change while its version does not."""
    own = (name for name in modules if _versions(name.partition(".")[0], True) is None)
    return reduce(Code.__or__, map(code_of, own), Code())


def _file(module: str) -> Path | None:
    """The source file, found without running the packages above it, which `find_spec("a.b")` would do."""
    top, *rest = module.split(".")
    origin, folders = _place(top)
    if not rest:
        return Path(origin) if origin and origin.endswith(".py") else None
    for folder in folders:
        stem = Path(folder, *rest)
        for path in (stem.with_suffix(".py"), stem / "__init__.py"):
            if path.is_file():
                return path
    return None


def _place(top: str) -> tuple[str | None, tuple[str, ...]]:
    try:
        spec = find_spec(top)
    except (ImportError, ValueError):
        spec = None
    return (None, ()) if spec is None else (spec.origin, tuple(spec.submodule_search_locations or ()))


def _path(name: str) -> Path | None:
    package, slash, rest = name.partition("/")
    if not slash:
        return _file(name)
    return next((path for folder in _place(package)[1] if (path := Path(folder, rest)).is_file()), None)


def _digest(path: Path, name: str) -> str | None:
    try:
        return effective_digest(path, "" if "/" in name else name).digest
    except OSError:
        return None


def _data(module: str) -> dict[str, str]:
    top, *rest = module.split(".")
    names = dict[str, str]()
    for root in _place(top)[1]:
        for path in _data_files(Path(root, *rest)):
            name = f"{top}/{path.relative_to(root).as_posix()}"
            if (digest := _digest(path, name)) is not None:
                names.setdefault(name, digest)
    return names


def _data_files(folder: Path) -> Iterator[Path]:
    try:
        entries = sorted(os.scandir(folder), key=lambda entry: entry.name)
    except OSError:
        return
    names = {entry.name for entry in entries}
    if names.intersection(_RESULTS):
        return
    for entry in entries:
        if entry.name.startswith((".", "__pycache__")):
            continue
        if entry.is_dir():
            yield from () if Path(entry.path, "__init__.py").is_file() else _data_files(Path(entry.path))
        elif not entry.name.endswith(_NO_DATA):
            yield Path(entry.path)


def _versions(top: str, packages: bool) -> dict[str, str] | None:
    """The versions behind a top-level module: none for Python's own and the harness; None if its source is to be
    followed.
    """
    origin, folders = _place(top)
    if top in sys.stdlib_module_names or top == "stlbench" or not (origin or folders):
        return {}
    place = Path(origin or folders[0])
    if not _INSTALLED.intersection(place.parts):
        return None
    named = _distributions(top, place) if packages else ()
    return {name: _version(name) for name in named} if named or not packages else None


@lru_cache(maxsize=1024)
def _distributions(top: str, place: Path) -> tuple[str, ...]:
    """The distributions that have this module. Most have its name; to search all takes half a second."""
    try:
        named = metadata.distribution(top)
        if place.is_relative_to(str(named.locate_file(top))):
            return (named.metadata["Name"],)
    except metadata.PackageNotFoundError:
        pass
    return tuple(sorted(set(_all_distributions().get(top, ()))))


@lru_cache(maxsize=1)
def _all_distributions() -> dict[str, list[str]]:
    return dict(metadata.packages_distributions())


@lru_cache(maxsize=1024)
def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"


def revision(kind: str, name: str | None = None) -> int | None:
    """The revision of the harness or the formula's view, or of a plugin by its kind and name; None if it has none."""
    number: int | None = _read()[kind] if name is None else _read()[kind].get(name)
    return number


@cache
def _read() -> dict[str, Any]:
    text = resources.files("stlbench.registry").joinpath("revisions.yaml").read_text(encoding="utf-8")
    return dict(yaml.safe_load(text))
