"""The page, from a folder's results to one file."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.records.outputs import write
from stlbench.records.result import Result
from stlbench.report.figures.palette import Colours, colours_of
from stlbench.report.page.bundle import packed, plotly, require
from stlbench.report.page.cells import Tags, cells_listed, details, tags_of
from stlbench.report.page.chart import Chart
from stlbench.report.page.listed import Listed, listed, of_columns
from stlbench.report.page.notes import said_once
from stlbench.report.page.of_fields import across
from stlbench.report.page.task_part import Tables, TaskPart, task_part
from stlbench.report.tables.across import Field, aggregates_table, fields, improvement_table
from stlbench.report.tables.alignment import align, alignment_table
from stlbench.report.tables.circumstances import circumstances
from stlbench.report.tables.comparisons import compare, comparisons_table
from stlbench.report.tables.hand_controllers import controllers_table
from stlbench.report.tables.outside import outside, trained
from stlbench.report.tables.planned import best_known, split
from stlbench.report.tables.robustness import robustness_table
from stlbench.report.tables.rows import Group, Row
from stlbench.report.tables.table import Table
from stlbench.report.tables.times import time_table

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard

FILE = "report.html"
"""Name of the page in a folder of results."""

MOST = 5000
"""Cells that a page has one by one. Its tables and charts are of all; of more cells, the file would be too large for a
browser."""

Told = Callable[[int, int], None]
"""Is told how many groups of how many are read."""


@dataclass(frozen=True)
class _Filtered:
    """A table whose rows can be filtered."""

    table: Listed
    tags: list[Tags]


@dataclass(frozen=True)
class _Across:
    """What is said over all tasks."""

    tables: list[Listed]
    charts: list[Chart]


def write_page(
    groups: Sequence[Group],
    results: Mapping[CellId, Result],
    standards: Mapping[str, Standard],
    folder: Path,
    told: Told = lambda done, total: None,
    path: Path | None = None,
) -> Path:
    """Write the page of a folder's results; the path.

    Args:
        groups: all of them, also those that were planned for.
        results: those of their cells, of which one is asked for at a time; cells without a result are not there.
        standards: of the tasks.
        folder: where traces, policies and logs are, as far as they are there.
        told: is called after each group of cells.
        path: the file, in the folder where none is given; folders above it are made.

    Raises:
        UsageError: jinja2 or plotly is not installed, or the file cannot be written.
    """
    require()
    path = path or folder / FILE
    text = _page(groups, results, standards, folder, told)
    try:
        return write(path, text)
    except UsageError as error:
        raise type(error)(f"{error}; --out FILE writes the page elsewhere") from error


def _page(
    groups: Sequence[Group],
    results: Mapping[CellId, Result],
    standards: Mapping[str, Standard],
    folder: Path,
    told: Told,
) -> str:
    tables, found = _tables(groups, standards)
    colours = colours_of(groups)
    over = _across(found, colours)
    parts, count = list[TaskPart](), [0]

    def one_more() -> None:
        count[0] += 1
        told(count[0], len(groups))

    for number, (_, members) in enumerate(groupby(groups, key=lambda each: each.setting.task)):
        parts.append(task_part(number, list(members), results, tables, colours, folder, one_more))
    ordered, left_out = _shown(groups)
    payloads = {part.key: _payload(part, ordered, results, folder) for part in parts}
    payloads["across"] = packed({"charts": {chart.key: chart.content() for chart in over.charts}})
    overview = _overview(groups, tables)
    return _rendered(
        title=folder.resolve().name or "results",
        overview=overview,
        cells=_Filtered(cells_listed(ordered, left_out), [tags_of([each]) for each in ordered]),
        of_task=[next(part.key for part in parts if part.name == str(each.id.task)) for each in ordered],
        across=over,
        parts=parts,
        said=said_once([overview.table, *(table for part in parts for table in part.all_tables)]),
        circumstances=listed(circumstances(trained(groups))),
        payloads=payloads,
    )


def _shown(groups: Sequence[Group]) -> tuple[list[Row], str]:
    """The cells that the page has in full, and what is said of the others."""
    count = sum(len(each.rows) for each in groups)
    if count <= MOST:
        return [row for each in groups for row in each.rows], ""
    seeds = max(1, MOST // len(groups))
    said = f"Of {count} cells the first {seeds} seeds of each setting; `stlbench show cell` shows any."
    return [row for each in groups for row in each.rows[:seeds]], said


def _tables(groups: Sequence[Group], standards: Mapping[str, Standard]) -> tuple[Tables, tuple[Field, ...]]:
    """The report's own tables, and the fields of tasks that are compared."""
    learned, best = split(groups)[0], best_known(groups, standards)
    tables = Tables(
        robustness=robustness_table(learned, best, standards, outside(groups)),
        comparisons=comparisons_table(compare(learned, standards, best)),
        alignment=alignment_table(align(groups, standards)),
        times=time_table(learned),
        controllers=controllers_table(standards),
    )
    return tables, fields(learned, standards, best)


def _overview(groups: Sequence[Group], tables: Tables) -> _Filtered:
    """Those columns of the table of robustness that a wide screen shows, and what training took."""
    table = tables.robustness
    titles = [column.title for column in table.columns if column.drop <= 2 and not column.below]
    by_setting = {_words(each): each for each in groups}
    tags = [tags_of(by_setting[tuple(map(str, line[:3])) + _rest(line)].rows) for line in table.rows]
    return _Filtered(listed(of_columns(table, titles)), tags)


def _words(each: Group) -> tuple[str, ...]:
    setting = each.setting
    budget = "unknown" if each.outside else setting.budget
    return (str(setting.task), str(setting.method), str(setting.agent), budget, setting.track)


def _rest(line: tuple[Any, ...]) -> tuple[str, str]:
    return str(line[3]), str(line[4])


def _across(found: Sequence[Field], colours: Colours) -> _Across:
    tables: list[Table] = [aggregates_table(found), improvement_table(found)]
    charts = [chart for i, field in enumerate(found) for chart in across(field, f"field-{i}", colours)]
    return _Across([listed(table) for table in tables if table.rows], charts)


def _payload(part: TaskPart, rows: Sequence[Row], results: Mapping[CellId, Result], folder: Path) -> str:
    cells = {str(i): details(each, results, folder) for i, each in enumerate(rows) if str(each.id.task) == part.name}
    return packed({"charts": {chart.key: chart.content() for chart in part.all_charts}, "cells": cells})


def _rendered(payloads: Mapping[str, str], **content: Any) -> str:
    """The template, filled in. Whatever a name holds is text there: jinja2 escapes it."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("stlbench.report.page", "parts"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    nonce = hashlib.sha256("".join(payloads.values()).encode()).hexdigest()[:32]
    return environment.get_template("page.html").render(
        nonce=nonce,
        plotly=plotly(),
        payloads=payloads,
        **content,
    )
