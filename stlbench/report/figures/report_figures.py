"""Figures of a report, from the numbers of cells alone: robustness by method, learning curves, all tasks, alignment.

A figure whose files were drawn from the same is not drawn again: matplotlib alone takes a second to import.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING

from stlbench.registry.choices import Choice
from stlbench.report.figures.files import Drawing, file_name
from stlbench.report.figures.regions import Load, Scale, scale_of_task
from stlbench.report.figures.style import Colours, colours_of, fitting, pages
from stlbench.report.tables.across import Field
from stlbench.report.tables.alignment import Aligned
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Width

if TYPE_CHECKING:
    from stlbench.report.report import Report

ROWS_PER_FIGURE = 24
"""Groups that have a row each."""


def write_figures(report: Report, folder: Path, load: Load, width: Width) -> list[Path]:
    """Draw what has changed of a report's figures; the paths of all files."""
    colours = colours_of(report.groups)
    with fitting(width):
        of_tasks = drawings_of_tasks(report.learned, colours, load).values()
        drawings = [
            *(drawing for several in of_tasks for drawing in several),
            *drawings_across(report.fields, colours),
            *drawings_of_alignment(report.aligned, load),
        ]
        return [path for drawing in drawings for path in drawing.write(folder)]


def drawings_of_tasks(groups: Sequence[Group], colours: Colours, load: Load) -> dict[Choice, list[Drawing]]:
    """Robustness by method, and learning curves, of each task that has a finished cell.

    If a task has more groups than one figure takes, further figures have names that end in _2, _3, ...
    """
    drawings = dict[Choice, list[Drawing]]()
    for task, members in groupby(groups, key=lambda group: group.setting.task):
        of_task, scale = list(members), scale_of_task(task, load)
        if any(group.done for group in of_task):
            drawings[task] = [
                Drawing(
                    file_name("robustness", str(task)) + end,
                    f"Robustness by seed of {len(page)} methods on {task}; the table of robustness has the numbers",
                    ("methods", "robustness_by_method"),
                    (page, scale, _own(colours, page)),
                )
                for end, page in pages(of_task, ROWS_PER_FIGURE)
            ]
            drawings[task] += drawings_of_learning(of_task, colours, scale)
    return drawings


def drawings_of_learning(groups: Sequence[Group], colours: Colours, scale: Scale) -> list[Drawing]:
    """Learning curves of one task's groups, each track by itself; none of results without checkpoints."""
    return [
        Drawing(
            file_name("learning", str(page[0].setting.task)) + ("" if track == "shared" else f"-{track}") + end,
            f"Satisfaction and robustness of the checkpoints of {len(page)} methods, against environment steps",
            ("methods", "learning_curves"),
            (page, scale, _own(colours, page)),
        )
        for track in dict.fromkeys(group.setting.track for group in groups)
        for end, page in pages([group for group in groups if group.setting.track == track])
        if any(numbers.curve for group in page for numbers in group.done)
    ]


def drawings_across(fields: Sequence[Field], colours: Colours) -> list[Drawing]:
    """One figure over all tasks of each budget and track."""
    label = (
        "Interquartile means of the methods over all tasks, and the share of runs above each score; the table "
        "across tasks has the numbers"
    )
    by_kind = dict[tuple[str, str], list[Field]]()
    for field in fields:
        by_kind.setdefault((field.budget, field.track), []).append(field)
    return [
        Drawing(
            file_name("across", *kind),
            label,
            ("across", "across_tasks"),
            (several, {entry.method: colours[entry.method] for entry in several[0].entries}),
        )
        for kind, several in by_kind.items()
    ]


def drawings_of_alignment(rows: Sequence[Aligned], load: Load) -> list[Drawing]:
    """One figure of all that was planned; none without a finished plan."""
    finished = [row for row in rows if row.reward_optimal is not None]
    units = {row.task: scale_of_task(row.task, load).unit for row in finished}
    label = "The best known robustness, the best policy by each reward, and what was learned with it"
    return [Drawing("alignment", label, ("across", "alignment"), (finished, units))] if finished else []


def _own(colours: Colours, groups: Sequence[Group]) -> dict[str, str]:
    return {method: colours[method] for method in (str(group.setting.method) for group in groups)}
