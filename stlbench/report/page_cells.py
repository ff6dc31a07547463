"""The cells of a page: their table, and all that is recorded of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from stlbench.records.identity import OUTSIDE
from stlbench.records.inputs import end_of_log, is_there
from stlbench.records.outputs import cell_files
from stlbench.records.result import Result
from stlbench.report.tables.cells import CELL, ENDED_EARLY, if_done, percent, scores_and_cost
from stlbench.report.tables.rows import Group, Numbers, Row
from stlbench.report.tables.table import Column, Table, Value

MOST = 350
"""Cells that a page has one by one, of 4 kB each. Its tables and figures are of all cells."""
_LOG_LINES = 60
Part = dict[str, Any]  # what the template shows of a task or a cell


def cells_shown(groups: Sequence[Group]) -> tuple[list[Row], Table]:
    """The cells that a page has one by one, and their table."""
    rows, notes = [row for group in groups for row in group.rows], list[str]()
    if len(rows) > MOST:
        seeds = max(1, MOST // len(groups))
        shown = [row for group in groups for row in group.rows[:seeds]][:MOST]
        which = f"first {seeds} seeds of each setting" if len(groups) <= MOST else f"first {len(shown)}"
        notes.append(f"This table has the {which}, not all {len(rows)} cells; `stlbench show cell` shows any.")
        rows = shown
    notes.append("Numbers are of the selected policy, from the report's starts. A cell opens for scores, cost and log.")
    numbers: dict[Column, Callable[[Numbers], Value]] = {
        Column("mean robustness", digits=3): lambda each: each.robustness_mean,
        Column("worst start", digits=3): lambda each: each.robustness_min,
        Column("satisfied", unit="%", digits=1): lambda each: 100 * each.satisfaction,
        Column("ended early", unit="%", digits=1): lambda each: percent(each.ended_early),
        Column("cell CPU", unit="s", digits=1): lambda each: each.cpu_seconds,
    }
    if any(row.numbers and row.numbers.ended_early for row in rows):
        notes.append(ENDED_EARLY)
    else:
        numbers = {column: value for column, value in numbers.items() if column.title != "ended early"}
    *first, reason = CELL.items()
    columns = {**dict(first), **if_done(numbers), **dict([reason])}
    return rows, Table.of("Cells", rows, columns, tuple(notes)).trimmed()


def cell_part(row: Row, result: Result | None, folder: Path) -> Part:
    """All that is recorded of one cell: facts, tables, and texts such as a traceback."""
    if result is None:
        facts = {"status": row.status, "budget": row.id.budget}
        return {"name": row.id.name, "facts": list(facts.items()), "tables": [], "texts": [], "provenance": []}
    files, measured, outside = cell_files(folder, result.id, result.key), result.measurement, row.id.track == OUTSIDE
    written = "\n".join(end_of_log(files.log, folder, _LOG_LINES))
    log = str(files.log.relative_to(folder)) if written else "none here: the cell wrote nothing, or it was not kept"
    facts = {
        "status": result.status,
        "reason": result.reason,
        "budget": result.id.budget,
        "track": result.id.track,
        "policy": _policy(result, files.policies, folder),
        "log": log,
    }
    texts = {"Traceback": result.details, "End of its log": written}
    return {
        "name": result.id.name,
        "facts": [(name, text) for name, text in facts.items() if text],
        "tables": [] if measured is None else scores_and_cost(measured, outside=outside),
        "texts": [(title, text) for title, text in texts.items() if text],
        "provenance": [*result.provenance.items(), ("key", result.key)],
    }


def _policy(result: Result, path: Path, folder: Path) -> str:
    stored = result.measurement.policies if result.measurement else None
    if stored is None:
        return "none is stored" if result.measurement else ""
    where = str(path.relative_to(folder)) if is_there(path, folder) else "its file is not in this folder"
    return f"{where}; SHA-256 selected {stored.selected}, final {stored.final}"
