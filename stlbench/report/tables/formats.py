"""One table, written in several ways: Markdown, LaTeX and on a terminal for people, CSV and records in full."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from itertools import chain

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from stlbench.report.tables.table import NOTHING, Column, Learned, Plain, Table, Value, learned_parts, show

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


def _texts(table: Table) -> list[list[str]]:
    """The rows for people."""
    return [
        [show(value, column.digits) for value, column in zip(row, table.columns, strict=True)] for row in table.rows
    ]


def to_markdown(table: Table) -> str:
    """A section: heading, table with padded columns, notes."""
    header = [_MARKDOWN.sub(r"\\\1", column.heading) for column in table.columns]
    body = [[_MARKDOWN.sub(r"\\\1", text) for text in row] for row in _texts(table)]
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
    """Header and rows in full, without title and notes; nothing to show is an empty field."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_headings(table))
    writer.writerows(_plain(row, table.columns) for row in table.rows)
    return text.getvalue()


def to_records(table: Table) -> list[dict[str, Plain]]:
    """One mapping per row, from heading to value, in full."""
    return [dict(zip(_headings(table), _plain(row, table.columns), strict=True)) for row in table.rows]


def _headings(table: Table) -> list[str]:
    return list(chain.from_iterable(column.headings for column in table.columns))


def _plain(row: Sequence[Value], columns: Sequence[Column]) -> list[Plain]:
    """The values of a row, those of compound ones side by side."""
    values: list[Plain] = []
    for value, column in zip(row, columns, strict=True):
        if isinstance(value, tuple):
            values += value
        else:
            values += [value, *[None] * (len(column.headings) - 1)]
    return values


def to_latex(table: Table) -> str:
    r"""A tabular for `\usepackage{booktabs}`, to be put into a table environment; title and notes are comments."""
    layout = "".join("r" if column.right else "l" for column in table.columns)
    return "\n".join(
        [
            *(f"% {' '.join(line.split())}" for line in (table.title, *table.notes)),
            rf"\begin{{tabular}}{{{layout}}}",
            r"\toprule",
            _latex_row([column.heading for column in table.columns]),
            r"\midrule",
            *(_latex_row(row) for row in _texts(table)),
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

    Where that is still too wide, columns are left out, and a line says which; where none can be, the table comes in
    parts, one below the other.
    """
    columns = table.columns
    rows = [[_folded(value, column.digits) for value, column in zip(row, columns, strict=True)] for row in table.rows]
    shared = [i for i, column in enumerate(columns) if column.shared and len({row[i] for row in rows}) == 1]
    below = [i for i, column in enumerate(columns) if column.below]
    inside = [i for i in range(len(columns)) if i not in (*shared, *below)]
    widths = {i: _least(columns[i], [row[i] for row in rows]) for i in inside}
    shown = _fitting(columns, widths, console.width)
    common = ", ".join(f"{columns[i].heading} {rows[0][i]}" for i in shared)
    console.print(Text(f"{table.title}: {common}" if common else table.title, style="bold"))
    for part in _parts(columns, {i: widths[i] for i in shown}, console.width):
        console.print(_laid_out(columns, rows, {i: widths[i] for i in part}))
        console.print()
    left_out = ", ".join(columns[i].heading for i in inside if i not in shown)
    remarks = _lines_below(columns, rows, below)
    notes = [*([f"Left out on this narrow screen: {left_out}."] if left_out else []), *table.notes]
    for line in [*(Text(remark) for remark in remarks), *(Text(note, style="dim") for note in notes)]:
        console.print(line)
    if remarks or notes:
        console.print()


def _folded(value: Value, digits: int | None) -> str:
    """A value on screen: the interval of what was learned stands on a line of its own."""
    if isinstance(value, Learned) and value.low is not None:
        robustness, ends, seeds = learned_parts(value, digits)
        return f"{robustness} {seeds}\n{ends}"
    return show(value, digits)


def _laid_out(columns: Sequence[Column], rows: Sequence[Sequence[str]], widths: Mapping[int, int]) -> RichTable:
    laid_out = RichTable(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for i, width in widths.items():
        if columns[i].right:
            laid_out.add_column(Text(columns[i].header), justify="right", width=width)
        else:
            laid_out.add_column(Text(columns[i].header), overflow="fold")
    for row in rows:
        laid_out.add_row(*(Text(row[i]) for i in widths))
    return laid_out


def _fitting(columns: Sequence[Column], widths: Mapping[int, int], width: int) -> list[int]:
    """Those of the columns that fit into `width` characters: droppable ones go first."""
    shown = list(widths)
    while sum(widths[i] + 2 for i in shown) > width and any(columns[i].drop for i in shown):
        shown.remove(max(reversed(shown), key=lambda i: columns[i].drop))
    return shown


def _parts(columns: Sequence[Column], widths: Mapping[int, int], width: int) -> list[list[int]]:
    """The columns in as few parts as fit into `width`, in their order; those that say what a row is of are in each."""
    names = [i for i in widths if columns[i].shared or columns[i].title == "method"]
    room = width - sum(widths[i] + 2 for i in names)
    parts = list[list[int]]([[]])
    for i in (i for i in widths if i not in names):
        if parts[-1] and sum(widths[j] + 2 for j in (*parts[-1], i)) > room:
            parts.append([])
        parts[-1].append(i)
    return [sorted([*names, *part]) for part in parts]


def _least(column: Column, texts: Sequence[str]) -> int:
    """The width at which a column still reads well: numbers unbroken, texts and headers broken between words."""
    header = max(len(word) for word in column.header.split())
    longest = max((len(line) for text in texts for line in text.splitlines()), default=0)
    return max(header, longest if column.right else min(longest, 16))


def _lines_below(columns: Sequence[Column], rows: Sequence[Sequence[str]], below: Sequence[int]) -> list[str]:
    identity = [i for i, column in enumerate(columns) if column.shared or column.title == "method"]
    return [
        f"{columns[i].title}: {'/'.join(row[j] for j in identity)}: {row[i]}"
        for i in below
        for row in rows
        if row[i] != NOTHING
    ]
