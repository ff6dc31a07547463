"""Two trees of files: those of a git revision in a folder of their own, and the working tree."""

from __future__ import annotations

import os
import subprocess
import tarfile
import tomllib
from collections.abc import Iterator, Mapping
from configparser import ConfigParser
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from stlbench.errors import UsageError
from stlbench.registry import plugins

INSTALLED = {"site-packages", "dist-packages"}
"""Folders of installed packages: a virtual environment within a repository is not its code."""


@dataclass(frozen=True)
class Tree:
    """The files of one revision, or the working tree."""

    name: str  # the revision and its hash, for messages
    root: Path
    environment: Mapping[str, str]
    """Environment variables of a process that runs this tree's code. All trees share the installed packages."""

    def holds(self, file: str) -> bool:
        return Path(file).is_relative_to(self.root) and not INSTALLED & {*Path(file).parts}


@contextmanager
def both_trees(revision: str) -> Iterator[tuple[Tree, Tree]]:
    """The tree of a revision, in a temporary folder, and the working tree of the repository around this folder.

    Raises `UsageError` without a repository, a revision, or an installed package that runs from the repository.
    """
    root = Path(_git(Path.cwd(), "rev-parse", "--show-toplevel").strip()).resolve()
    try:
        commit = _git(root, "rev-parse", "--verify", "--quiet", "--end-of-options", f"{revision}^{{commit}}").strip()
    except UsageError as error:
        hint = "in a shallow clone, fetch its history first (fetch-depth: 0)"
        raise UsageError(f"--against {revision}: there is no such revision in {root}; {hint}") from error
    roots = _import_roots(root)
    with TemporaryDirectory(prefix="stlbench-gate-") as folder:
        base = Path(folder).resolve() / "base"
        _take_out(root, commit, base)
        places = base, root
        environments = [_environment(root, place, roots, Path(folder) / f"{place.name}-metadata") for place in places]
        names = f"{revision} ({commit[:12]})", "the working tree"
        yield tuple(map(Tree, names, places, environments))  # type: ignore[misc]


def _git(folder: Path, *words: str) -> str:
    command = ["git", "-C", str(folder), *words]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603 - words of our own
    if ended.returncode:
        raise UsageError(f"git {words[0]} in {folder}: {(ended.stderr.strip() or 'it failed').splitlines()[-1]}")
    return ended.stdout


def _take_out(root: Path, commit: str, folder: Path) -> None:
    """Write the files of a commit. Unlike a git worktree, they leave no trace in the repository after a kill."""
    archive = folder.with_suffix(".tar")
    _git(root, "archive", "--format=tar", f"--output={archive}", commit)
    with tarfile.open(archive) as file:
        file.extractall(folder, filter="data")
    archive.unlink()


def _import_roots(root: Path) -> list[Path]:
    """The folders, relative to the repository, from which stlbench and the installed plugins are imported."""
    modules = [plugin.entry_point.module for kind in plugins.KINDS for plugin in plugins.available(kind).values()]
    specs = [
        find_spec(package) for package in dict.fromkeys(["stlbench", *(name.partition(".")[0] for name in modules)])
    ]
    places = [place for spec in specs if spec for place in [*(spec.submodule_search_locations or ()), spec.origin][:1]]
    folders = dict.fromkeys(Path(place).resolve().parent for place in places if place)
    own = [folder for folder in folders if folder.is_relative_to(root) and not INSTALLED & {*folder.parts}]
    if not own:
        rule = "so both sides would run the same code; install it by `pip install -e`"
        raise UsageError(f"neither stlbench nor a plugin is run from the files in {root}, {rule}")
    return [folder.relative_to(root) for folder in own]


def _environment(root: Path, place: Path, roots: list[Path], folder: Path) -> dict[str, str]:
    """The tree's code, and its entry points, which name the plugins, go before the installed ones."""
    inherited = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    others = [path for path in inherited if not Path(path).resolve().is_relative_to(root)]
    _write_entry_points(place / "pyproject.toml", folder)
    paths = [str(folder), *(str(place / each) for each in roots), *others]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OMP_NUM_THREADS": "1"}


def _write_entry_points(project_file: Path, folder: Path) -> None:
    """Write the entry points of the tree's pyproject.toml as metadata that shadow the installed distribution's."""
    try:
        project = tomllib.loads(project_file.read_text(encoding="utf-8")).get("project", {})
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot read {project_file}: {error}") from error
    name, groups = str(project.get("name", "")), project.get("entry-points", {})
    if not name or not groups:
        return
    try:
        version = metadata.version(name)
    except metadata.PackageNotFoundError:
        version = "0"
    info = folder / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", encoding="utf-8")
    points = ConfigParser(delimiters=("=",))
    points.optionxform = str  # type: ignore[assignment,method-assign]
    points.read_dict(groups)
    with (info / "entry_points.txt").open("w", encoding="utf-8") as file:
        points.write(file)
