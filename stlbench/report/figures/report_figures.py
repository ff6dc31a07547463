"""Figures of a report, from the numbers of cells alone: robustness by method, and learning curves."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from stlbench.report.figures.files import file_name, save
from stlbench.report.figures.learning import has_curves, learning_curves
from stlbench.report.figures.palette import pages
from stlbench.report.figures.robustness import robustness_by_method
from stlbench.report.figures.units import unit_of_task
from stlbench.report.tables.rows import Group

__all__ = ["draw", "draw_learning"]


def draw(groups: Sequence[Group], folder: Path) -> list[Path]:
    """Draw both figures of each task that has a finished cell; the files' paths.

    Where a task has more groups than can be told apart, further figures have names that end in _2, _3, ... There are no
    learning curves of results without checkpoints.
    """
    paths = []
    for task, members in groupby(groups, key=lambda group: group.setting.task):
        of_task = list(members)
        if any(group.done for group in of_task):
            for end, page in pages(of_task):
                figure = robustness_by_method(page, unit_of_task(task))
                paths += save(figure, folder, file_name("robustness", str(task)) + end)
            paths += draw_learning(of_task, folder)
    return paths


def draw_learning(groups: Sequence[Group], folder: Path) -> list[Path]:
    """Draw the learning curves of one task's groups, on as many pages as it takes; the files' paths."""
    task, paths = groups[0].setting.task, list[Path]()
    for end, page in pages(groups):
        if has_curves(page):
            paths += save(learning_curves(page, unit_of_task(task)), folder, file_name("learning", str(task)) + end)
    return paths
