"""`stlbench report`: the tables and figures of a folder of results, from its ledger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.common import Json, console, print_json
from stlbench.errors import UsageError

if TYPE_CHECKING:
    from stlbench.report import Group
    from stlbench.result import Score


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that `stlbench run` wrote.")],
    as_json: Json = False,
) -> None:
    """Rebuild the tables and figures from a ledger.

    Covers all cells that are recorded in DIR, prints the tables and rewrites the files. --json prints an object with
    the lists robustness, controllers, time and cells.

    \b
    Examples:
      stlbench report results
      stlbench report results --json
    """
    from stlbench.report import condense, write
    from stlbench.study import stored

    groups = condense(stored.read(folder), stored.missing(folder))
    if not groups:
        raise UsageError(f"{stored.locate(folder)} holds no result yet")
    if as_json:
        scores = _controllers(groups)
        write(groups, scores, folder)
        print_json(_content(groups, scores))
    else:
        show_report(groups, groups, folder)


def show_report(shown: Sequence[Group], groups: Sequence[Group], folder: Path) -> None:
    """Write all files, of all groups; then print the tables of those that are to be shown, and where the files lie."""
    from stlbench.report import summary, to_screen, write

    out, scores = console(), _controllers(groups)
    write(groups, scores, folder)
    tasks = {group.setting.task.name for group in shown}
    for table in summary(shown, {task: score for task, score in scores.items() if task in tasks}):
        to_screen(table, out)
    files = "report.md, robustness, controllers and time (.csv, .tex), cells.csv, figures/"
    typer.echo(f"Written to {folder}/: {files}")


def _controllers(groups: Sequence[Group]) -> dict[str, Score]:
    """Task -> the score of its controller by hand. Some seconds for a task on a MuJoCo model."""
    from stlbench.rollout import controller

    return controller.scores(group.setting.task for group in groups)


def _content(groups: Sequence[Group], scores: Mapping[str, Score]) -> dict[str, Any]:
    from stlbench.report import cells_table, controllers_table, robustness_table, time_table, to_records

    return {
        "robustness": to_records(robustness_table(groups)),
        "controllers": to_records(controllers_table(scores)),
        "time": to_records(time_table(groups)),
        "cells": to_records(cells_table(row for group in groups for row in group.rows)),
    }
