"""Costs by turns: base and new, each in a tree of files of its own, train the same cell one right after the other,
until each cost is clear.

Each turn gives one ratio. The median ratio of a setting is compared with the tolerated one by its exact 95 % interval,
which assumes no distribution (the interval of the sign test: Conover 1999, Practical Nonparametric Statistics, 3.2).
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import tarfile
import tomllib
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from configparser import ConfigParser
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any, NamedTuple, Self

import numpy as np
from scipy import special

from stlbench.errors import UsageError, counted, one_line
from stlbench.gate.judge import Comparison, Judgement, Verdict, compare, judge, values_of
from stlbench.gate.snapshot import COSTS, QUALITIES, Metric, Sample, Snapshot
from stlbench.records.identity import CellId, Setting
from stlbench.registry import plugins
from stlbench.statistics.intervals import median_interval

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


MOST = 50  # turns of a setting after which its verdict stays open
ROUNDS = 2  # the fewest rounds after which anything is worse: slower code stays slow, and disturbances go
FEWEST = 6  # turns from which on the median has an interval of 95 %


class Turn(NamedTuple):
    """One cell, trained by both sides; None if a revision does not know the cell."""

    cell: CellId
    round: int
    """Rounds count from 1. Each round has each cell of a setting once."""
    base: Sample | None
    new: Sample | None


def judge_turns(reference: Snapshot, turns: Sequence[Turn]) -> tuple[Judgement, Snapshot]:
    """The verdict on a change, and the snapshot of its cells.

    Costs are compared turn by turn. Robustness and satisfaction are compared with the reference if the two are equal,
    else with the base's values on this machine: the reference's machine may round differently.
    """
    first = [turn for turn in turns if turn.round == 1]
    new = Snapshot({turn.cell: turn.new for turn in first if turn.new is not None})
    given = {turn.cell: turn.base for turn in first if turn.base is not None}
    expected = {
        cell: sample if _same(sample, new.samples.get(cell)) else given.get(cell, sample)
        for cell, sample in reference.samples.items()
    }
    judgement = judge(Snapshot(expected), new)
    qualities = (comparison for comparison in judgement.comparisons if not comparison.metric.is_cost)
    return Judgement((*qualities, *judge_costs(turns)), judgement.findings), new


def _same(one: Sample, two: Sample | None) -> bool:
    return two is not None and all(metric.value(one) == metric.value(two) for metric in QUALITIES)


def judge_costs(turns: Iterable[Turn]) -> tuple[Comparison, ...]:
    """Both costs of each setting of which both sides finished a cell.

    A setting is *worse* if its whole interval is above the tolerated ratio after two rounds or more, and *no worse* if
    its whole interval is at most that ratio; otherwise the turns *cannot tell*.
    """
    settings = defaultdict[Setting, list[Turn]](list)
    for turn in turns:
        settings[turn.cell.setting].append(turn)
    compared = (_by_turns(setting, metric, own) for metric in COSTS for setting, own in sorted(settings.items()))
    return tuple(comparison for comparison in compared if comparison is not None)


def unclear(turns: Sequence[Turn]) -> set[Setting]:
    """The settings that need more turns: the verdict on one of their costs is still open."""
    taken = Counter(turn.cell.setting for turn in turns)
    open_ones = {each.setting for each in judge_costs(turns) if each.verdict == "cannot tell"}
    return {setting for setting in open_ones if taken[setting] < MOST}


def _by_turns(setting: Setting, metric: Metric, turns: Sequence[Turn]) -> Comparison | None:
    pairs = [(turn.base, turn.new) for turn in turns]
    compared = compare(setting, metric, pairs)
    if compared is None:
        return None
    gains = metric.gain(*values_of(metric, pairs).T)
    low, high = (len(gains) >= FEWEST and median_interval(gains.tolist())) or (-math.inf, math.inf)
    verdict: Verdict = "cannot tell"
    if low >= -metric.tolerated:
        verdict = "no worse"
    elif high < -metric.tolerated and max(turn.round for turn in turns) >= ROUNDS:
        verdict = "worse"
    chance = float(special.bdtr(int(np.sum(gains >= -metric.tolerated)), len(gains), 0.5))
    return replace(compared, low=low, high=high, chance=chance, verdict=verdict, gains=tuple(gains.tolist()))


def take_turns(cells: Collection[CellId], base: Tree, new: Tree, say: Callable[[str], None]) -> list[Turn]:
    """Train each cell with both trees, and repeat the settings whose costs are not clear yet.

    One training runs at a time. Settings take turns too, so that other load on the machine affects all of them.
    Raises `UsageError` if a tree cannot train, or the base runs code of the change.
    """
    turns: list[Turn] = []
    waiting, number = sorted(cells, key=lambda cell: (cell.seed, cell)), 0
    while waiting:
        number += 1
        say(f"round {number}: {counted(len(waiting), 'cell')}, each by {base.name} and by {new.name}")
        with Trainer(base, new) as one, Trainer(new, base) as other:  # a process that happens to be slow does not stay
            turns += [_turn(cell, number, one, other) for cell in waiting]
        settings = unclear(turns)
        waiting = [cell for cell in waiting if cell.setting in settings]
    return turns


def _turn(cell: CellId, number: int, base: Trainer, new: Trainer) -> Turn:
    if (cell.seed + number) % 2:
        before, after = base.train(cell), new.train(cell)
    else:
        after, before = new.train(cell), base.train(cell)
    return Turn(cell, number, before, after)


class Trainer:
    """A process that trains with the code of `tree` (`stlbench.gate.trainer`), and with no code of `other`."""

    def __init__(self, tree: Tree, other: Tree) -> None:
        self.tree, self.other = tree, other
        self.errors = TemporaryFile()  # noqa: SIM115 - closed at the end of this context
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "stlbench.gate.trainer"],
            cwd=tree.root,
            env=dict(tree.environment),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            text=True,
            start_new_session=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)  # also the process of a cell that still trains
        self.process.communicate()
        self.errors.close()

    def train(self, cell: CellId) -> Sample | None:
        """The cell's numbers; None if this tree does not know the cell.

        Raises:
            UsageError: the process ended, or loaded a module of the other tree.
        """
        answer = self._answer(json.dumps(cell.plain))
        status, reason = answer.pop("status"), one_line(answer.pop("reason"))
        foreign = [file for file in answer.pop("files", ()) if self.other.holds(file)]
        if foreign:
            raise UsageError(f"{self.tree.name} cannot be measured: its training loads {foreign[0]}")
        return None if status == "unknown" else Sample(cell, status, reason, answer)

    def _answer(self, request: str) -> dict[str, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            self.process.stdin.write(request + "\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            self.process.wait()
            self.errors.seek(0)
            lines = self.errors.read().decode(errors="replace").strip().splitlines()
            raise UsageError(f"{self.tree.name} cannot train: {one_line((lines or ['no reason given'])[-1])}")
        answer: dict[str, Any] = json.loads(line)
        return answer
