"""Figures from what a run recorded: learning curves, robustness in its funnel, trajectories; PNG and SVG."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

from matplotlib.figure import Figure

from stlbench.contract import Intractable, Unsuitable
from stlbench.errors import UsageError
from stlbench.presentation import Band, Banded
from stlbench.registry.choices import Choice
from stlbench.report.figures.drawing import file_name, pages, save
from stlbench.report.figures.learning import learning_curves
from stlbench.report.figures.margins import robustness_in_time
from stlbench.report.figures.plane import trajectories
from stlbench.report.tables.rows import Group, group, row
from stlbench.result import Result
from stlbench.rollout.traces import Recording, gather, load
from stlbench.task import build_method, load_task
from stlbench.task.task import Task

__all__ = ["draw"]

Tell = Callable[[str], None]


@dataclass(frozen=True)
class _Places:
    """Where traces lie and figures go, and whom to tell of what is missing."""

    run: Path
    out: Path
    warn: Tell


def draw(results: Iterable[Result], run: Path, out: Path, *, tell: Tell, warn: Tell) -> list[Path]:
    """Draw all figures of these results into the folder `out`.

    A task has learning-<task>; each method, agent and budget has time-<...> and trajectories-<...>, over all seeds.

    Args:
        results: of a run, one a cell (`Ledger.results`).
        run: the run's folder, where the traces lie.
        out: where the figures go, over those of before.
        tell: is told of each group that is drawn.
        warn: is told what could not be drawn, and why.

    Returns:
        The files' paths.

    Raises:
        UsageError: a name in the ledger cannot name a file, or the folder cannot be written.
    """
    kept = list(results)
    groups = group(row(result) for result in kept)
    done = [replace(result, measurement=None) for result in kept if result.measurement is not None]
    places, paths, count = _Places(run, out, warn), list[Path](), 0
    try:
        for _, members in groupby(groups, key=lambda entry: entry.setting.task):
            shown = list(members)
            paths += _learning(shown, out)
            for entry in shown:
                count += 1
                files = _group(entry, [result for result in done if result.id.setting == entry.setting], places)
                tell(f"[{count}/{len(groups)}] {entry.setting.name} {entry.setting.budget}: {len(files)} files")
                paths += files
    except OSError as error:
        raise UsageError(f"cannot write the figures: {error}") from error
    return paths


def _learning(groups: Sequence[Group], out: Path) -> list[Path]:
    paths = []
    for end, page in pages(groups):
        if any(entry.done for entry in page):
            paths += save(learning_curves(page), out, file_name("learning", str(groups[0].setting.task)) + end)
    return paths


def _group(entry: Group, results: Sequence[Result], places: _Places) -> list[Path]:
    """The figures of one method on one task, from the traces of its seeds."""
    if not results:
        return []
    setting = entry.setting
    try:
        task = load_task(setting.task)
    except UsageError as error:
        places.warn(f"no traces of {setting.task} are drawn: {error}")
        return []
    recordings = list[Recording]()
    for result in results:
        try:
            recordings.append(load(task, result, places.run))
        except UsageError as error:
            places.warn(str(error))
    if not recordings:
        return []
    pooled, parts = gather(recordings), (str(setting.task), str(setting.method), str(setting.agent), setting.budget)
    title = f"{setting.task}, {setting.method} ({setting.agent}, {setting.budget})"
    figures: dict[str, Figure | None] = {
        "time": robustness_in_time(task, pooled, _bands(task, setting.method), title),
        "trajectories": trajectories(task, pooled, title),
    }
    return [
        path
        for kind, figure in figures.items()
        if figure is not None
        for path in save(figure, places.out, file_name(kind, *parts))
    ]


def _bands(task: Task, method: Choice) -> Sequence[Band]:
    """The method's bounds on the robustness; none where it has none, or is not installed here any more."""
    try:
        made = build_method(task, method)
    except (UsageError, Unsuitable, Intractable):
        return ()
    return made.band() if isinstance(made, Banded) else ()
