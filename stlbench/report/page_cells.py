"""The cells on the page: a row for each, and all that is recorded of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from stlbench.records.cell_files import cell_files, end_of_log
from stlbench.records.result import Result
from stlbench.report.tables.cells import ENDED_EARLY, cost_table, scores_table
from stlbench.report.tables.rows import Group, Numbers, Row
from stlbench.report.tables.table import Column, Table

MOST = 2000
"""Cells that a page has one by one. Its tables and figures are of all cells."""
_LOG_LINES = 60


@dataclass(frozen=True)
class CellPart:
    """All that is recorded of one cell."""

    name: str
    facts: list[tuple[str, str]]
    tables: list[Table]
    texts: list[tuple[str, str]]
    """Traceback and end of the log, as far as there are any."""
    provenance: list[tuple[str, str]]


def first_cells(groups: Sequence[Group]) -> tuple[list[Row], str]:
    """The cells that the page has one by one, and what is said of the others."""
    count = sum(len(each.rows) for each in groups)
    if count <= MOST:
        return [row for each in groups for row in each.rows], ""
    seeds = max(1, MOST // len(groups))
    note = f"Of {count} cells the first {seeds} seeds of each setting; `stlbench show cell` shows any."
    return [row for each in groups for row in each.rows[:seeds]], note


def cells_shown(rows: Sequence[Row], left_out: str = "") -> Table:
    """One row per cell for people; `left_out` is said of cells that are not among them."""
    columns = (
        *(Column(title, right=False) for title in ("cell", "budget", "status")),
        Column("mean robustness", digits=3),
        Column("worst start", digits=3),
        Column("satisfied", unit="%", digits=1),
        Column("ended early", unit="%", digits=1),
        Column("cell CPU", unit="s", digits=1),
        Column("reason", right=False),
    )
    note = "Of the selected policy, from the report's starts. Open a cell for its scores, cost, provenance and log."
    early = any(row.numbers and row.numbers.ended_early for row in rows)
    notes = (*([left_out] if left_out else []), note, *([ENDED_EARLY] if early else []))
    body = tuple(
        (row.id.name, row.id.budget, row.status, *_page_numbers(row.numbers, early), row.reason or None) for row in rows
    )
    return Table("Cells", columns, body, notes)


def _page_numbers(numbers: Numbers | None, early: bool) -> tuple[float | None, ...]:
    if numbers is None:
        return (None,) * 5
    ended = None if numbers.ended_early is None or not early else 100 * numbers.ended_early
    return numbers.robustness_mean, numbers.robustness_min, 100 * numbers.satisfaction, ended, numbers.cpu_seconds


def cell_part(row: Row, result: Result | None, folder: Path) -> CellPart:
    if result is None:
        return CellPart(row.id.name, [("status", row.status), ("budget", row.id.budget)], [], [], [])
    files, measured = cell_files(folder, result.id, result.key), result.measurement
    written = "\n".join(end_of_log(files.log, _LOG_LINES))
    facts = {
        "status": result.status,
        "reason": result.reason,
        "budget": result.id.budget,
        "track": result.id.track,
        "policy": _policy(result, files.policies, folder),
        "log": str(files.log.relative_to(folder))
        if written
        else "none here: the cell wrote nothing, or it was not kept",
    }
    tables = list[Table]()
    if measured is not None and result.id.track == "outside":
        tables = [scores_table({"": measured.selected})]
    elif measured is not None:
        tables = [scores_table({"selected": measured.selected, "final": measured.final}), cost_table(measured)]
    return CellPart(
        name=result.id.name,
        facts=[(name, text) for name, text in facts.items() if text],
        tables=tables,
        texts=[(title, text) for title, text in (("Traceback", result.details), ("End of its log", written)) if text],
        provenance=[*result.provenance.items(), ("key", result.key)],
    )


def _policy(result: Result, path: Path, folder: Path) -> str:
    stored = result.measurement.policies if result.measurement else None
    if stored is None:
        return "none is stored" if result.measurement else ""
    where = str(path.relative_to(folder)) if path.is_file() else "its file is not in this folder"
    return f"{where}; SHA-256 selected {stored.selected}, final {stored.final}"
