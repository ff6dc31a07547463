"""`stlbench report`: the tables and figures of a folder of results, from its ledger."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from stlbench.cli.common import Json, console, print_json, warn
from stlbench.cli.options import Explain, Fitting, TaskFolders
from stlbench.errors import DiskFull, UsageError

if TYPE_CHECKING:
    from stlbench.report import Group, Width
    from stlbench.rollout.standards import Standard


def report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="A folder that `stlbench run` wrote.")],
    html: Annotated[bool, typer.Option("--html", help="Write report.html alone: one page with everything.")] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="With --html: the page's file.", show_default="DIR/report.html")
    ] = None,
    width: Fitting = "page",
    explain: Explain = False,
    task_folders: TaskFolders = None,
    as_json: Json = False,
) -> None:
    """Rebuild the tables and figures from a ledger.

    Covers all cells that are recorded in DIR, prints the tables and rewrites the files. Without the right to write in
    DIR, it warns and prints the tables alone. --width column makes figures and LaTeX for one column of a paper.
    --explain prints the notes of the tables too. --json prints an object with the lists robustness, comparisons,
    aggregates, improvement, controllers, alignment, time and cells. --html writes one file in place of all that: tables
    to sort and filter, charts, traces, and every cell, for any browser, without a network. It needs the extra `page`.
    Prints its path; with --json an object with path and bytes.

    \b
    Examples:
      stlbench report results
      stlbench report results --html
      stlbench report results --width column
      stlbench report results --html --out page.html
      stlbench report results --json
    """
    if html:
        from stlbench.cli.report_page import report_page

        report_page(folder, out, as_json)
        return
    if out is not None:
        raise UsageError("--out is the file of the page that --html writes; add --html")
    from stlbench.records import stored
    from stlbench.report import condense

    groups = condense(stored.read(folder), stored.missing(folder))
    if not groups:
        raise UsageError(f"{stored.locate(folder)} holds no result yet")
    if as_json:
        known = standards_of(groups)
        _write(groups, known, folder, width)
        print_json(_content(groups, known))
    else:
        show_report(groups, groups, folder, explain, width)


def show_report(
    shown: Sequence[Group], groups: Sequence[Group], folder: Path, explain: bool, width: Width = "page"
) -> None:
    """Write all files, of all groups; then print the tables of those that are to be shown, and where the files lie.

    The notes of the tables are printed if the user asks to `explain`; else two lines say where they are.
    """
    from stlbench.report import split, summary, to_screen

    out, known = console(), standards_of(groups)
    is_written = _write(groups, known, folder, width)
    tasks = {group.setting.task.name for group in shown}
    for table in summary(shown, {task: each for task, each in known.items() if task in tasks}, groups):
        to_screen(table, out, explain=explain)
    if not explain:
        typer.echo(f"How to read the tables: stlbench report {shlex.quote(str(folder))} --explain")
    if not is_written:
        return
    if not explain:
        typer.echo(f"All columns, with the notes below each table: {folder}/report.md")
    planned = ", alignment" if split(groups)[1] else ""
    files = f"report.md, robustness, comparisons, controllers{planned} and time (.csv, .tex), cells.csv, figures/"
    typer.echo(f"Written to {folder}/: {files}")


def _write(groups: Sequence[Group], known: Mapping[str, Standard], folder: Path, width: Width) -> bool:
    """Write all files. Whether that was possible: who may only read a folder is shown the tables, with a warning."""
    from stlbench.report import write

    try:
        write(groups, known, folder, width)
    except DiskFull:
        raise
    except UsageError as error:
        warn(str(error))
        return False
    return True


def standards_of(groups: Sequence[Group]) -> dict[str, Standard]:
    """What the policies of each task are compared with. Some seconds for a task on a MuJoCo model."""
    from rich.console import Console

    from stlbench.registry import plugins
    from stlbench.rollout.standards import standards
    from stlbench.study.plugin_guard import ask

    unknown = {group.setting.task.name for group in groups} - plugins.available("tasks").keys()
    if unknown:
        warn(
            f"not installed: {', '.join(sorted(unknown))}; what needs the task is left out. "
            "If you trust its folder, name it: --task-folder PATH"
        )
    said = Console(stderr=True, highlight=False)
    with said.status("controllers of the tasks") if said.is_terminal else nullcontext():
        return standards((group.setting for group in groups), ask)


def _content(groups: Sequence[Group], known: Mapping[str, Standard]) -> dict[str, Any]:
    from stlbench import report

    learned, best = report.split(groups)[0], report.best_known(groups, known)
    found = report.fields(learned, known, best)
    tables = {
        "robustness": report.robustness_table(learned, best, known, report.outside(groups)),
        "comparisons": report.comparisons_table(report.compare(learned, known, best)),
        "aggregates": report.aggregates_table(found),
        "improvement": report.improvement_table(found),
        "controllers": report.controllers_table(known),
        "alignment": report.alignment_table(report.align(groups, known)),
        "time": report.time_table(learned),
        "cells": report.cells_table(row for group in groups for row in group.rows),
    }
    return {name: report.to_records(table) for name, table in tables.items()}
