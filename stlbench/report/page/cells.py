"""The page's cells: a row for each, and all that is recorded of it for who opens it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stlbench.records.cell_files import cell_files, end_of_log
from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.report.page.chart import numbers
from stlbench.report.page.listed import Listed, listed
from stlbench.report.tables.cell import ENDED_EARLY, cost_table, scores_table
from stlbench.report.tables.rows import Row
from stlbench.report.tables.table import Column, Table

_LOG_LINES = 60


@dataclass(frozen=True)
class Tags:
    """By what rows are filtered."""

    task: str
    method: str
    agent: str
    track: str
    status: tuple[str, ...]
    """One of a cell, one or more of a group."""


def tags_of(rows: Sequence[Row]) -> Tags:
    """Of cells that differ in nothing but the seed."""
    cell = rows[0].id
    statuses = tuple(dict.fromkeys(row.status for row in rows))
    return Tags(str(cell.task), str(cell.method), str(cell.agent), cell.track, statuses)


def cells_listed(rows: Sequence[Row], left_out: str = "") -> Listed:
    """One row per cell; the first column is what opens it. `left_out` is said of cells that are not among them."""
    early = any(row.numbers and row.numbers.ended_early for row in rows)
    columns = (
        Column("cell", right=False),
        Column("budget", right=False),
        Column("status", right=False),
        Column("mean robustness", digits=3),
        Column("worst start", digits=3),
        Column("satisfied", unit="%", digits=1),
        *([Column("ended early", unit="%", digits=1)] if early else []),
        Column("cell CPU", unit="s", digits=1),
        Column("reason", right=False),
    )
    body = tuple((row.id.name, row.id.budget, row.status, *_values(row, early), row.reason or None) for row in rows)
    note = "Of the selected policy, from the report's starts. Open a cell for its scores, cost, provenance and log."
    notes = (*([left_out] if left_out else []), note, *([ENDED_EARLY] if early else []))
    return listed(Table("Cells", columns, body, notes))


def _values(row: Row, early: bool) -> tuple[float | None, ...]:
    of = row.numbers
    if of is None:
        return (None,) * (4 + early)
    ended = None if of.ended_early is None else 100 * of.ended_early
    shares = (100 * of.satisfaction, ended) if early else (100 * of.satisfaction,)
    return of.robustness_mean, of.robustness_min, *shares, of.cpu_seconds


def details(row: Row, results: Mapping[CellId, Result], folder: Path) -> dict[str, Any]:
    """What is shown of one cell, as plain values. Texts are texts: the script puts them in as such."""
    result = results.get(row.id)
    if result is None:
        return {
            "name": row.id.name,
            "facts": [["status", row.status], ["budget", row.id.budget]],
            "tables": [],
            "provenance": [],
        }
    log = cell_files(folder, result.id, result.key).log
    written = end_of_log(log, _LOG_LINES)
    said = {
        "status": result.status,
        "reason": result.reason,
        "budget": result.id.budget,
        "track": result.id.track,
        "policy": _policy(result, folder),
        "log": _log(log, folder, bool(written)),
    }
    return {
        "name": result.id.name,
        "facts": [[name, text] for name, text in said.items() if text],
        "tables": [table.content() for table in _tables(result)],
        "provenance": [*map(list, result.provenance.items()), ["key", result.key]],
        "traceback": result.details,
        "written": "\n".join(written),
        "curve": _curve(result),
    }


def _tables(result: Result) -> list[Listed]:
    measured = result.measurement
    if measured is None:
        return []
    if result.id.track == "outside":
        return [listed(scores_table({"": measured.selected}))]
    return [
        listed(scores_table({"selected": measured.selected, "final": measured.final})),
        listed(cost_table(measured)),
    ]


def _policy(result: Result, folder: Path) -> str:
    stored = result.measurement.policies if result.measurement else None
    if stored is None:
        return "none is stored" if result.measurement else ""
    path = cell_files(folder, result.id, result.key).policies
    where = str(path.relative_to(folder)) if path.is_file() else "its file is not in this folder"
    return f"{where}; SHA-256 selected {stored.selected}, final {stored.final}"


def _log(log: Path, folder: Path, written: bool) -> str:
    return str(log.relative_to(folder)) if written else "none here: the cell wrote nothing, or it was not kept"


def _curve(result: Result) -> list[list[float | None]]:
    """Steps, satisfaction in percent, robustness."""
    points = result.measurement.curve if result.measurement else ()
    return [
        numbers(point.steps for point in points),
        numbers(100 * point.satisfaction for point in points),
        numbers(point.robustness_mean for point in points),
    ]
