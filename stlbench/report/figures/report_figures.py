"""Figures of a report, from the numbers of cells alone: robustness by method, learning curves, all tasks, alignment.

A figure whose files are there, drawn from the same, is not drawn again: matplotlib alone takes a second to import.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from stlbench.report.figures.files import drawn, file_name, save, source_of
from stlbench.report.figures.palette import Colours, pages
from stlbench.report.figures.units import Scale, scale_of_task
from stlbench.report.tables.across import Field
from stlbench.report.tables.alignment import Aligned
from stlbench.report.tables.rows import Group

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Kind = Literal["robustness", "learning"]
ROWS_PER_FIGURE = 24
"""Groups that have a row each."""


def draw(groups: Sequence[Group], folder: Path, colours: Colours) -> list[Path]:
    """Draw what has changed of both figures of each task that has a finished cell; the paths of all files.

    Where a task has more groups than one figure takes, further figures have names that end in _2, _3, ... There are no
    learning curves of results without checkpoints.
    """
    paths = []
    for _, members in groupby(groups, key=lambda group: group.setting.task):
        of_task = list(members)
        if any(group.done for group in of_task):
            for end, page in pages(of_task, ROWS_PER_FIGURE):
                paths += _draw("robustness", page, folder, end, colours)
            paths += draw_learning(of_task, folder, colours)
    return paths


def draw_learning(groups: Sequence[Group], folder: Path, colours: Colours) -> list[Path]:
    """Draw the learning curves of one task's groups, each track by itself, on as many pages as it takes; the paths."""
    tracks = dict.fromkeys(group.setting.track for group in groups)
    return [
        path
        for track in tracks
        for end, page in pages([group for group in groups if group.setting.track == track])
        if any(numbers.curve for group in page for numbers in group.done)
        for path in _draw("learning", page, folder, f"{'' if track == 'shared' else f'-{track}'}{end}", colours)
    ]


def draw_across(fields: Sequence[Field], folder: Path, colours: Colours) -> list[Path]:
    """Draw what has changed of the figures over all tasks, one of each budget and track; the paths of all files."""
    paths = []
    for (budget, track), members in groupby(fields, key=lambda field: (field.budget, field.track)):
        shown = tuple(members)
        name, source = (
            file_name("across", budget, track),
            source_of("across", shown, [colours[each.method] for each in shown[0].entries]),
        )
        paths += drawn(folder, name, source) or save(_across(shown, colours), folder, name, source)
    return paths


def _across(fields: Sequence[Field], colours: Colours) -> Figure:
    from stlbench.report.figures.across import across_tasks

    return across_tasks(fields, colours)


def draw_alignment(rows: Sequence[Aligned], folder: Path) -> list[Path]:
    """Draw what has changed of the one figure of all that was planned; the files' paths, none where nothing was."""
    finished = [row for row in rows if row.reward_optimal is not None]
    if not finished:
        return []
    units = {row.task: scale_of_task(row.task).unit for row in finished}
    source = source_of("alignment", units, finished)
    return drawn(folder, "alignment", source) or save(_alignment(finished, units), folder, "alignment", source)


def _alignment(rows: Sequence[Aligned], units: Mapping[str, str]) -> Figure:
    from stlbench.report.figures.alignment import alignment

    return alignment(rows, units)


def _draw(kind: Kind, page: Sequence[Group], folder: Path, end: str, colours: Colours) -> list[Path]:
    task = page[0].setting.task
    name, scale = file_name(kind, str(task)) + end, scale_of_task(task)
    source = source_of(kind, scale, page, [colours[str(group.setting.method)] for group in page])
    return drawn(folder, name, source) or save(_figure(kind, page, scale, colours), folder, name, source)


def _figure(kind: Kind, page: Sequence[Group], scale: Scale, colours: Colours) -> Figure:
    from stlbench.report.figures.learning import learning_curves
    from stlbench.report.figures.robustness import robustness_by_method

    if kind == "robustness":
        return robustness_by_method(page, scale.unit, colours)
    return learning_curves(page, scale.unit, colours, scale.most)
