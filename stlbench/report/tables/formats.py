"""One table, written in several ways: Markdown, CSV, LaTeX, plain values, and on a terminal."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from stlbench.report.tables.table import NOTHING, Column, Table

__all__ = ["to_csv", "to_latex", "to_markdown", "to_records", "to_screen"]

_MARKDOWN = re.compile(r"([\\`*|<])")
_MINUS = re.compile(r"(?<![^\s{[(}])-(?=\d)")
_LATEX = {
    "\\": r"\textbackslash{}",
    "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "|": r"\textbar{}",
    "[": "{[}",
    "]": "{]}",
} | {character: "\\" + character for character in "&%$#_{}"}


def to_markdown(table: Table) -> str:
    """A section: heading, table with padded columns, notes."""
    header = [_MARKDOWN.sub(r"\\\1", column.title) for column in table.columns]
    body = [[_MARKDOWN.sub(r"\\\1", text) for text in row] for row in table.rows]
    widths = [max(3, *(len(line[i]) for line in [header, *body])) for i in range(len(header))]
    rule = [
        "-" * (width - 1) + (":" if column.right else "-") for width, column in zip(widths, table.columns, strict=True)
    ]
    lines = [_padded(line, widths, table.columns) for line in [header, rule, *body]]
    return "\n".join([f"## {table.title}", "", *lines, "", *(f"- {note}" for note in table.notes)]) + "\n"


def _padded(line: Sequence[str], widths: Sequence[int], columns: Sequence[Column]) -> str:
    padded = [
        text.rjust(width) if column.right else text.ljust(width)
        for text, width, column in zip(line, widths, columns, strict=True)
    ]
    return f"| {' | '.join(padded)} |"


def to_csv(table: Table) -> str:
    """Header and rows, without title and notes; nothing to show is an empty field."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(column.title for column in table.columns)
    writer.writerows([["" if field == NOTHING else field for field in row] for row in table.rows])
    return text.getvalue()


def to_latex(table: Table) -> str:
    r"""A tabular for `\usepackage{booktabs}`, to be put into a table environment; title and notes are comments."""
    layout = "".join("r" if column.right else "l" for column in table.columns)
    return "\n".join(
        [
            *(f"% {' '.join(line.split())}" for line in (table.title, *table.notes)),
            rf"\begin{{tabular}}{{{layout}}}",
            r"\toprule",
            _latex_row([column.title for column in table.columns]),
            r"\midrule",
            *(_latex_row(row) for row in table.rows),
            r"\bottomrule",
            r"\end{tabular}",
            "",
        ]
    )


def _latex_row(row: Sequence[str]) -> str:
    return " & ".join(_latex_text(text) for text in row) + r" \\"


def _latex_text(text: str) -> str:
    if text == NOTHING:
        return "--"
    escaped = "".join(_LATEX.get(character, character) for character in " ".join(text.split()))
    return _MINUS.sub("$-$", escaped)


def to_screen(table: Table, console: Console) -> None:
    """Print the table as wide as the console: what all rows share goes into the title, long texts go below.

    Where that is still too wide, columns are left out, and a line says which.
    """
    shared = [i for i, column in enumerate(table.columns) if column.shared and len({row[i] for row in table.rows}) == 1]
    below = [i for i, column in enumerate(table.columns) if column.below]
    inside = [i for i in range(len(table.columns)) if i not in (*shared, *below)]
    shown = _fitting(table, inside, console.width)
    common = ", ".join(f"{table.columns[i].title} {table.rows[0][i]}" for i in shared)
    console.print(Text(f"{table.title}: {common}" if common else table.title, style="bold"))
    console.print(_laid_out(table, shown))
    console.print()
    left_out = ", ".join(table.columns[i].title for i in inside if i not in shown)
    remarks = _lines_below(table, below)
    notes = [*([f"Left out on this narrow screen: {left_out}."] if left_out else []), *table.notes]
    for line in [*(Text(remark) for remark in remarks), *(Text(note, style="dim") for note in notes)]:
        console.print(line)
    if remarks or notes:
        console.print()


def _laid_out(table: Table, shown: Sequence[int]) -> RichTable:
    laid_out = RichTable(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for i in shown:
        column = table.columns[i]
        if column.right:
            laid_out.add_column(Text(column.header), justify="right", width=_least(table, i))
        else:
            laid_out.add_column(Text(column.header), overflow="fold")
    for row in table.rows:
        laid_out.add_row(*(Text(row[i]) for i in shown))
    return laid_out


def _fitting(table: Table, columns: Sequence[int], width: int) -> list[int]:
    """Those of the columns that fit into `width` characters: droppable ones go first."""
    shown = list(columns)
    while sum(_least(table, i) + 2 for i in shown) > width and any(table.columns[i].drop for i in shown):
        shown.remove(max(reversed(shown), key=lambda i: table.columns[i].drop))
    return shown


def _least(table: Table, i: int) -> int:
    """The width at which a column still reads well: numbers unbroken, texts and headers broken between words."""
    header = max(len(word) for word in table.columns[i].header.split())
    longest = max((len(row[i]) for row in table.rows), default=0)
    return max(header, longest if table.columns[i].right else min(longest, 16))


def _lines_below(table: Table, below: Sequence[int]) -> list[str]:
    identity = [i for i, column in enumerate(table.columns) if column.shared or column.title == "method"]
    return [
        f"{table.columns[i].title}: {'/'.join(row[j] for j in identity)}: {row[i]}"
        for i in below
        for row in table.rows
        if row[i] != NOTHING
    ]


def to_records(table: Table) -> list[dict[str, Any]]:
    """One mapping a row, from header to text; in columns of numbers to a number, or to the two of an interval."""
    titles = [column.title for column in table.columns]
    return [dict(zip(titles, map(_value, row, table.columns), strict=True)) for row in table.rows]


def _value(text: str, column: Column) -> Any:
    if text in (NOTHING, ""):
        return None
    try:
        return json.loads(text) if column.right else text
    except ValueError:
        return text
