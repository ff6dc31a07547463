"""Results, shown: tables (Markdown, CSV, LaTeX, terminal) and figures, from `stlbench.records.result` alone."""

from __future__ import annotations

from collections.abc import Container, Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from stlbench.records import outputs
from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.report.tables.across import aggregates_table, fields, improvement_table
from stlbench.report.tables.alignment import Aligned, align, alignment_table
from stlbench.report.tables.cells import cells_table, unfinished_table
from stlbench.report.tables.circumstances import circumstances
from stlbench.report.tables.comparisons import Comparison, compare, comparisons_table
from stlbench.report.tables.formats import to_csv, to_latex, to_markdown, to_records, to_screen
from stlbench.report.tables.hand_controllers import controllers_table
from stlbench.report.tables.outside import outside, trained
from stlbench.report.tables.planned import best_known, split
from stlbench.report.tables.robustness import robustness_table
from stlbench.report.tables.rows import Group, Row, group, missing_row, row
from stlbench.report.tables.summary import summary
from stlbench.report.tables.table import Column, Table, Value, Width, show
from stlbench.report.tables.times import time_table

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard

__all__ = [
    "Aligned",
    "Column",
    "Comparison",
    "Group",
    "Row",
    "Table",
    "Value",
    "Width",
    "aggregates_table",
    "align",
    "alignment_table",
    "best_known",
    "cells_table",
    "compare",
    "comparisons_table",
    "condense",
    "controllers_table",
    "fields",
    "group",
    "improvement_table",
    "only",
    "outside",
    "robustness_table",
    "row",
    "show",
    "split",
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


def write(
    groups: Sequence[Group], standards: Mapping[str, Standard], folder: Path, width: Width = "page"
) -> list[Path]:
    """Write every table into `folder`, and every figure that an earlier report did not draw alike; all files' paths.

    report.md has all tables, and how they came about; robustness, comparisons, controllers and time (.csv, .tex) and
    cells.csv one each, aggregates too of three tasks or more, and alignment where anything was planned; figures/ a few
    of each task. Figures and LaTeX fit the `width`. `standards` are of the tasks; where no controller is known, the
    files of controllers have no row.
    Raises `UsageError` where the folder cannot be written, or a file or folder in it is a link.
    """
    from stlbench.report.figures import report_figures  # imports all of tasks, and the tables do without
    from stlbench.report.figures.palette import colours_of
    from stlbench.report.figures.style import fitting

    figures, colours = outputs.inside(folder / "figures", folder), colours_of(groups)
    learned, rows = split(groups)[0], align(groups, standards)
    found = fields(learned, standards, best_known(groups, standards))
    texts = [outputs.write(folder / name, text) for name, text in _texts(groups, standards, rows, width).items()]
    with fitting(width):
        return [
            *texts,
            *report_figures.draw(learned, figures, colours),
            *report_figures.draw_across(found, figures, colours),
            *report_figures.draw_alignment(rows, figures),
        ]


def _texts(
    groups: Sequence[Group], standards: Mapping[str, Standard], rows: Sequence[Aligned], width: Width
) -> dict[str, str]:
    """File name -> content."""
    learned, best = split(groups)[0], best_known(groups, standards)
    found = fields(learned, standards, best)
    tables = {
        "robustness": robustness_table(learned, best, standards, outside(groups)),
        "comparisons": comparisons_table(compare(learned, standards, best)),
        **({"aggregates": aggregates_table(found), "improvement": improvement_table(found)} if found else {}),
        "controllers": controllers_table(standards),
        **({"alignment": alignment_table(rows)} if rows else {}),
        "time": time_table(learned),
    }
    text = "\n".join(map(to_markdown, (*summary(groups, standards), circumstances(trained(groups)))))
    files = {"report.md": f"# stlbench report\n\n{text}"}
    for name, table in tables.items():
        files |= {f"{name}.csv": to_csv(table), f"{name}.tex": to_latex(table, width)}
    return {**files, "cells.csv": to_csv(cells_table(row for group in groups for row in group.rows))}
