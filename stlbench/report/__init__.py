"""Results for readers: one `Report` has all tables; terminal, Markdown, CSV, LaTeX, JSON and page show them."""

from __future__ import annotations

from collections.abc import Container, Iterable
from itertools import chain

from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.report.report import Report, write
from stlbench.report.tables.formats import to_csv, to_latex, to_markdown, to_records, to_screen
from stlbench.report.tables.rows import Group, Row, group, missing_row, row
from stlbench.report.tables.table import Column, Table, Value, Width, show

__all__ = [
    "Column",
    "Group",
    "Report",
    "Row",
    "Table",
    "Value",
    "Width",
    "condense",
    "only",
    "show",
    "to_csv",
    "to_latex",
    "to_markdown",
    "to_records",
    "to_screen",
    "write",
]


def condense(results: Iterable[Result], missing: Iterable[CellId] = ()) -> tuple[Group, ...]:
    """Read results one at a time, and gather a few numbers of each in groups that differ in nothing but the seed.

    The `missing` are cells that were planned and have no result (`Ledger.missing`).
    """
    return group(chain(map(row, results), map(missing_row, missing)))


def only(groups: Iterable[Group], cells: Container[CellId]) -> tuple[Group, ...]:
    return group(row for group in groups for row in group.rows if row.id in cells)
