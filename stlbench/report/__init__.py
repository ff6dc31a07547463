"""Results, shown: tables (Markdown, CSV, LaTeX, terminal) and figures, from `stlbench.result` alone."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path

from stlbench.errors import UsageError
from stlbench.report.tables.circumstances import circumstances
from stlbench.report.tables.formats import to_csv, to_latex, to_markdown, to_records, to_screen
from stlbench.report.tables.rows import Group, Row, group, missing_row, row
from stlbench.report.tables.table import Column, Table, Value, show
from stlbench.report.tables.tables import (
    cells_table,
    controllers_table,
    robustness_table,
    summary,
    time_table,
    unfinished_table,
)
from stlbench.result import CellId, Result, Score

__all__ = [
    "Column",
    "Group",
    "Row",
    "Table",
    "Value",
    "cells_table",
    "condense",
    "controllers_table",
    "group",
    "only",
    "robustness_table",
    "row",
    "show",
    "summary",
    "time_table",
    "to_csv",
    "to_latex",
    "to_markdown",
    "to_records",
    "to_screen",
    "unfinished_table",
    "write",
]


def condense(results: Iterable[Result], missing: Iterable[CellId] = ()) -> tuple[Group, ...]:
    """Read results one at a time, keep a few numbers of each, and gather those that differ in nothing but the seed.

    The `missing` are cells that were planned and have no result (`Ledger.missing`).
    """
    return group(chain(map(row, results), map(missing_row, missing)))


def only(groups: Iterable[Group], cells: Container[CellId]) -> tuple[Group, ...]:
    """The groups without other cells than these."""
    return group(row for group in groups for row in group.rows if row.id in cells)


def write(groups: Sequence[Group], scores: Mapping[str, Score], folder: Path) -> list[Path]:
    """Write every table into `folder`, and every figure that an earlier report did not draw alike; all files' paths.

    report.md has all tables, and how they came about; robustness, controllers and time (.csv, .tex) and cells.csv one
    each; figures/ a few of each task. `scores` are those of the controllers, by task; where there are none, their files
    have no row.
    Raises `UsageError` where the folder cannot be written.
    """
    from stlbench.report.figures import report_figures  # imports all of tasks, and the tables do without

    try:
        folder.mkdir(parents=True, exist_ok=True)
        texts = {folder / name: text for name, text in _texts(groups, scores).items()}
        for path, text in texts.items():
            path.write_text(text, encoding="utf-8")
        return [*texts, *report_figures.draw(groups, folder / "figures")]
    except OSError as error:
        raise UsageError(f"cannot write the report: {error}") from error


def _texts(groups: Sequence[Group], scores: Mapping[str, Score]) -> dict[str, str]:
    """File name -> content."""
    robust, hand, time = robustness_table(groups), controllers_table(scores), time_table(groups)
    tables = (*summary(groups, scores), circumstances(groups))
    return {
        "report.md": "# stlbench report\n\n" + "\n".join(map(to_markdown, tables)),
        "robustness.csv": to_csv(robust),
        "robustness.tex": to_latex(robust),
        "controllers.csv": to_csv(hand),
        "controllers.tex": to_latex(hand),
        "time.csv": to_csv(time),
        "time.tex": to_latex(time),
        "cells.csv": to_csv(cells_table(row for group in groups for row in group.rows)),
    }
