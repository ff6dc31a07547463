"""The code behind a module: its files by their bytes, and its class's revision. Imports nothing of it."""

from __future__ import annotations

import ast
import hashlib
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, reduce
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

TASK_FILE = "task.yaml"  # the name that a task's file always has
BY_HAND_FILE = "by_hand.yaml"  # and that of the file beside it, which has what somebody made so that it is learned
_TASK_FILES = (TASK_FILE, BY_HAND_FILE)
_NO_DATA = (".py", ".pyc", ".pyi", ".md", ".rst", ".typed", "~")
"""How names end of files beside modules that are no data."""
_RESULTS = ("ledger.sqlite", "cells.jsonl", "cells.jsonl.xz")
"""A folder that has one of these is of results, which a run writes."""
_INSTALLED = {"site-packages", "dist-packages"}


@dataclass(frozen=True)
class Code:
    """The parts of a module and of all that it imports, as far as it can change what they do."""

    files: tuple[tuple[str, str], ...] = ()
    """Name and digest of each module, `pack.one`, and of each file of data beside one, `pack/table.npz`; sorted."""
    packages: tuple[tuple[str, str], ...] = ()
    """Name and version of each installed distribution that is imported; sorted."""

    def __or__(self, other: Code) -> Code:
        files, packages = {*self.files, *other.files}, {*self.packages, *other.packages}
        return Code(tuple(sorted(files)), tuple(sorted(packages)))

    @cached_property
    def digest(self) -> str:
        """The digest of the files, 32 hex digits. Files of tasks have no part in it: a task's key has what they say."""
        text = [f"{name} {digest}\n" for name, digest in self.files if name.rpartition("/")[2] not in _TASK_FILES]
        return hashlib.sha256("".join(text).encode()).hexdigest()[:32]

    @property
    def changed(self) -> str | None:
        """The first file or distribution that is no longer the same; None if all are."""
        for name, digest in self.files:
            path = _path(name)
            if path is None or _digest(path) != digest:
                return str(path or name)
        packages = (name for name, version in self.packages if _version(name) != version)  # not as it was once
        return next(packages, None)


def code_of(module: str, *, packages: bool = True) -> Code:
    """The code of a module: itself, the packages that it lies in, what these import by name, and so on.

    An installed distribution counts by its version, unless it has the module's own top-level package. Python's own
    modules do not count. Files of data in the folder of a package count, and in folders below it that are no packages:
    all but hidden files, Markdown, and folders of results. The place of files does not count. An import by a
    name that is made at run time is not seen.
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
            read = _source(path, name)
            files[name], imported = read.digest, read.imports
        pending |= {*imported, name.rpartition(".")[0]} - {*seen, ""}
    return Code(tuple(sorted(files.items())), tuple(sorted(installed.items())))


def own_code(modules: Iterable[str]) -> Code:
    """The code (`code_of`) of those modules that are the user's own: of no installed distribution, or of one that is
    installed editable, so that its source can change while its version does not."""
    own = (name for name in modules if _versions(name.partition(".")[0], True) is None)
    return reduce(Code.__or__, map(code_of, own), Code())


def revision(module: str, name: str) -> int:
    """The attribute `revision` in the body of a class, or of a module where the name is empty; 1 where it has none.

    It is read from the source, since the key of a cell that is done should import no plugin.
    """
    path = _file(module)
    return 1 if path is None else _source(path, module).revisions.get(name, 1)


@dataclass(frozen=True)
class _Source:
    digest: str  # 16 hex digits
    imports: tuple[str, ...] = ()
    """The names that it imports anywhere; some may be no modules: `package.thing` of `from package import thing`."""
    revisions: Mapping[str, int] = field(default_factory=dict)
    """The revision of each class by its name, and of the module by an empty one."""


def _source(path: Path, module: str) -> _Source:
    """Read a file, unless it was read before and has the same size and time; no module is data. Raises `OSError`."""
    seen = path.stat()
    return _read(path, module, (seen.st_mtime_ns, seen.st_size, seen.st_ino))


@lru_cache(maxsize=4096)
def _read(path: Path, module: str, seen: tuple[int, ...]) -> _Source:
    content = path.read_bytes()
    digest = hashlib.sha256(content).hexdigest()[:16]
    try:
        tree = ast.parse(content if module else b"")
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return _Source(digest)
    package = module if path.name == "__init__.py" else module.rpartition(".")[0]
    names = (name for node in _run(tree) for name in _targets(node, package))
    blocks = {"": tree.body} | {node.name: node.body for node in tree.body if isinstance(node, ast.ClassDef)}
    revisions = {name: number for name, body in blocks.items() for number in _revisions(body)}
    return _Source(digest, tuple(dict.fromkeys(names)), revisions)


def _run(tree: ast.Module) -> Iterator[ast.AST]:
    """All statements but those that type checkers alone read. Expressions have no imports."""
    pending: list[ast.AST] = [tree]
    while pending:
        node = pending.pop()
        yield node
        children: Iterable[ast.AST] = ast.iter_child_nodes(node)
        if isinstance(node, ast.If) and ast.unparse(node.test) in ("TYPE_CHECKING", "typing.TYPE_CHECKING"):
            children = node.orelse
        pending += (child for child in children if isinstance(child, ast.stmt | ast.excepthandler | ast.match_case))


def _targets(node: ast.AST, package: str) -> Iterator[str]:
    if isinstance(node, ast.Import):
        yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
        above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
        base = ".".join([*above, *([node.module] if node.module else [])])
        yield base
        yield from (f"{base}.{alias.name}" for alias in node.names)


def _revisions(body: Iterable[ast.stmt]) -> Iterator[int]:
    for node in body:
        match node:
            case ast.Assign(targets=[ast.Name(id="revision")], value=ast.Constant(value=int(number))):
                yield number


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


def _digest(path: Path) -> str | None:
    try:
        return _source(path, "").digest
    except OSError:
        return None


def _data(module: str) -> dict[str, str]:
    top, *rest = module.split(".")
    names = dict[str, str]()
    for root in _place(top)[1]:
        for path in _data_files(Path(root, *rest)):
            name = f"{top}/{path.relative_to(root).as_posix()}"
            if (digest := _digest(path)) is not None:
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
        if entry.is_dir(follow_symlinks=False):
            yield from () if Path(entry.path, "__init__.py").is_file() else _data_files(Path(entry.path))
        elif entry.is_file() and not entry.name.endswith(_NO_DATA):
            yield Path(entry.path)


def _versions(top: str, packages: bool) -> dict[str, str] | None:
    """The versions behind a top-level module: none for Python's own and the harness; None if its source is to be
    followed.
    """
    origin, folders = _place(top)
    if top in sys.stdlib_module_names or top == "stlbench" or not (origin or folders):
        return {}
    place = origin or folders[0]
    if not _INSTALLED.intersection(Path(place).parts):
        return None
    named = _distributions(top, place) if packages else ()
    return {name: version_of(name) for name in named} if named or not packages else None


def distributions(top: str) -> tuple[str, ...]:
    """The distributions that have a top-level module."""
    origin, folders = _place(top)
    return _distributions(top, origin or next(iter(folders), ""))


@lru_cache(maxsize=1024)
def _distributions(top: str, place: str) -> tuple[str, ...]:
    """Of a module at a place. Most have its name; to search all takes half a second."""
    try:
        named = metadata.distribution(top)
        if Path(place).is_relative_to(str(named.locate_file(top))):
            return (named.metadata["Name"],)
    except metadata.PackageNotFoundError:
        pass
    return tuple(sorted(set(all_distributions().get(top, ()))))


@lru_cache(maxsize=1)
def all_distributions() -> dict[str, list[str]]:
    """Top-level module -> the distributions that have it."""
    return dict(metadata.packages_distributions())


@lru_cache(maxsize=1024)
def version_of(distribution: str) -> str:
    """The version that was installed when this process asked first."""
    return _version(distribution)


def _version(distribution: str) -> str:
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return "not installed"
