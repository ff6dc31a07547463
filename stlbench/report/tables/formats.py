"""One table in several formats: Markdown, LaTeX and the terminal are rounded; CSV and records have all digits."""

from __future__ import annotations

import csv
import io
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from typing import NamedTuple

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from stlbench.report.tables.table import NOTHING, Column, Learned, Plain, Table, Value, Width, learned_parts, show

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
_CHARACTERS: Mapping[Width, int] = {"column": 64, "page": 130}
"""Of 3.95 points, as 8-point text takes them with the space between columns.

A column of IEEE has 252 points, a page 516."""
_LINES = 60  # of 9.5 points, on a page of IEEE, with its caption
_TEXT = 16  # characters of a line of text in a column that is no wider than necessary


def to_markdown(table: Table) -> str:
    """A section: heading, table with padded columns, notes."""
    columns = table.columns
    texts = [[show(value, column.digits) for value, column in zip(row, columns, strict=True)] for row in table.rows]
    header, *body = [
        [_MARKDOWN.sub(r"\\\1", text) for text in line] for line in ([column.heading for column in columns], *texts)
    ]
    widths = [max(3, *map(len, texts)) for texts in zip(header, *body, strict=True)]
    rule = ["-" * (width - 1) + (":" if column.right else "-") for width, column in zip(widths, columns, strict=True)]
    lines = []
    for line in (header, rule, *body):
        cells = zip(line, widths, columns, strict=True)
        padded = [text.rjust(width) if column.right else text.ljust(width) for text, width, column in cells]
        lines.append(f"| {' | '.join(padded)} |")
    return "\n".join([f"## {table.title}", "", *lines, "", *(f"- {note}" for note in table.notes)]) + "\n"


def to_csv(table: Table) -> str:
    """Header and rows in full, without title and notes; None is an empty field."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([_headings(table), *_plain(table)])
    return text.getvalue()


def to_records(table: Table) -> list[dict[str, Plain]]:
    """One mapping for each row, from heading to value, in full."""
    return [dict(zip(_headings(table), row, strict=True)) for row in _plain(table)]


def _headings(table: Table) -> list[str]:
    return list(chain.from_iterable(column.headings for column in table.columns))


def _plain(table: Table) -> Iterator[list[Plain]]:
    for row in table.rows:
        values: list[Plain] = []
        for value, column in zip(row, table.columns, strict=True):
            values += value if isinstance(value, tuple) else [value, *[None] * (len(column.headings) - 1)]
        yield values


def to_latex(table: Table, width: Width = "page") -> str:
    r"""Tabulars for `\usepackage{booktabs}` in text of 8 points, no wider than a column or a page of two columns.

    Comments have the notes, the long texts and what all rows share. Columns are left out as on a screen of that width;
    a comment names them. A table that is still too wide, or longer than a page, comes in several tabulars.
    """
    columns = table.columns
    rows = [[_stacked(value, column.digits) for value, column in zip(row, columns, strict=True)] for row in table.rows]
    lines = [[_wrapped(text, column) for text, column in zip(row, columns, strict=True)] for row in rows]
    widths = {
        i: max(len(line) for cell in (_header(column), *(row[i] for row in lines)) for line in cell)
        for i, column in enumerate(columns)
    }
    fit = _fit(table, rows, widths, _CHARACTERS[width])
    notes = [f"% {' '.join(note.split())}" for note in table.notes]
    too_wide = any(sum(part.values()) + 2 * len(part) > _CHARACTERS[width] for part in fit.parts)
    varying = [i for i, column in enumerate(columns) if column.shared and len({row[i] for row in rows}) > 1]
    if too_wide and varying:
        return "\n".join([*notes, *(to_latex(some, width) for some in _split(table, varying[0]))])
    comments = (fit.title, *([f"Left out: {fit.left_out}."] if fit.left_out else []), *fit.remarks)
    tabulars = [_tabular(columns, some, part) for part in fit.parts for some in _pages(lines, part)]
    return "\n".join([*(f"% {' '.join(line.split())}" for line in comments), *notes, "\n\n".join(tabulars), ""])


def _split(table: Table, place: int) -> Iterator[Table]:
    """A table without notes for each value of a column."""
    for value in dict.fromkeys(row[place] for row in table.rows):
        yield Table(table.title, table.columns, tuple(row for row in table.rows if row[place] == value))


def _stacked(value: Value, digits: int | None) -> str:
    """A value on one line, but for the interval of what was learned."""
    return _folded(value, digits) if isinstance(value, Learned) else " ".join(show(value, digits).split())


def _wrapped(text: str, column: Column) -> list[str]:
    """The lines of a value: words stay whole, and so do numbers."""
    return text.splitlines() if column.right else textwrap.wrap(text, _TEXT, break_long_words=False) or [""]


def _header(column: Column) -> list[str]:
    return textwrap.wrap(column.header, 12, break_long_words=False, break_on_hyphens=False)


def _pages(rows: Sequence[Sequence[Sequence[str]]], part: Mapping[int, int]) -> Iterator[list[Sequence[Sequence[str]]]]:
    """The rows of each tabular, at most as many lines as a page takes."""
    page, height = list[Sequence[Sequence[str]]](), 0
    for row in rows:
        needs = max(len(row[i]) for i in part)
        if page and height + needs > _LINES:
            yield page
            page, height = [], 0
        page.append(row)
        height += needs
    yield page


def _tabular(columns: Sequence[Column], rows: Iterable[Sequence[Sequence[str]]], part: Mapping[int, int]) -> str:
    sides = ["r" if columns[i].right else "l" for i in part]
    heads = [_latex_cell(_header(columns[i]), side, "b") for i, side in zip(part, sides, strict=True)]
    body = [[_latex_cell(row[i], side, "t") for i, side in zip(part, sides, strict=True)] for row in rows]
    head, *lines = [" & ".join(row) + r" \\" for row in (heads, *body)]
    return "\n".join(
        [
            r"{\fontsize{8}{9.5}\selectfont\setlength{\tabcolsep}{3pt}%",
            rf"\begin{{tabular}}{{@{{}}{''.join(sides)}@{{}}}}",
            r"\toprule",
            head,
            r"\midrule",
            *lines,
            r"\bottomrule",
            r"\end{tabular}}",
        ]
    )


def _latex_cell(lines: Sequence[str], side: str, place: str) -> str:
    """A value. One of several lines is a tabular of its own, aligned at the top or the bottom."""
    texts = [_latex_text(line) for line in lines]
    if len(texts) == 1:
        return texts[0]
    stacked = r" \\ ".join(texts)
    return rf"\begin{{tabular}}[{place}]{{@{{}}{side}@{{}}}}{stacked}\end{{tabular}}"


def _latex_text(text: str) -> str:
    if text == NOTHING:
        return "--"
    escaped = "".join(_LATEX.get(character, character) for character in " ".join(text.split()))
    return _MINUS.sub("$-$", escaped)


def to_screen(table: Table, console: Console, *, explain: bool = True) -> None:
    """Print the table as wide as the console. What all rows share goes into the title, long texts go below.

    A table that is too wide loses columns, and a line names them. One without such columns comes in parts, one below
    the other. Notes follow unless `explain` is off.
    """
    columns = table.columns
    rows = [[_folded(value, column.digits) for value, column in zip(row, columns, strict=True)] for row in table.rows]
    widths = {i: _least(column, [row[i] for row in rows]) for i, column in enumerate(columns)}
    fit = _fit(table, rows, widths, console.width)
    console.print(Text(fit.title, style="bold"))
    for part in fit.parts:
        console.print(_laid_out(columns, rows, part))
        console.print()
    notes = [
        *([f"Left out on this narrow screen: {fit.left_out}."] if fit.left_out else []),
        *(table.notes if explain else ()),
    ]
    for line in [*(Text(remark) for remark in fit.remarks), *(Text(note, style="dim") for note in notes)]:
        console.print(line)
    if fit.remarks or notes:
        console.print()


def _folded(value: Value, digits: int | None) -> str:
    """A value on screen: the interval of what was learned stands on a line of its own."""
    if isinstance(value, Learned) and value.low is not None:
        robustness, ends, seeds = learned_parts(value, digits)
        return f"{robustness} {seeds}\n{ends}"
    return show(value, digits)


def _least(column: Column, texts: Sequence[str]) -> int:
    """The width at which a column still reads well: numbers unbroken, texts and headers broken between words."""
    header = max(len(word) for word in column.header.split())
    longest = max((len(line) for text in texts for line in text.splitlines()), default=0)
    return max(header, longest if column.right else min(longest, _TEXT))


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


class _Fit(NamedTuple):
    title: str  # with what all rows share
    parts: list[dict[int, int]]  # columns that are printed in one line, each with its width in characters
    left_out: str
    remarks: list[str]  # the long texts


def _fit(table: Table, rows: Sequence[Sequence[str]], widths: Mapping[int, int], width: int) -> _Fit:
    """Choose the columns of these widths that fit into `width` characters; `rows` are the values as they are shown."""
    columns, alike = table.columns, table.alike
    inside = [i for i, column in enumerate(columns) if i not in alike and not column.below]
    shown = list(inside)
    while sum(widths[i] + 2 for i in shown) > width and any(columns[i].drop for i in shown):
        shown.remove(max(reversed(shown), key=lambda i: columns[i].drop))
    names = [i for i, column in enumerate(columns) if column.shared or column.title == "method"]
    return _Fit(
        title=table.title_with(alike),
        parts=[{i: widths[i] for i in part} for part in _parts(shown, names, widths, width)],
        left_out=", ".join(columns[i].heading for i in inside if i not in shown),
        remarks=[
            f"{column.title}: {'/'.join(row[j] for j in names)}: {row[i]}"
            for i, column in enumerate(columns)
            if column.below
            for row in rows
            if row[i] != NOTHING
        ],
    )


def _parts(shown: Sequence[int], names: Sequence[int], widths: Mapping[int, int], width: int) -> list[list[int]]:
    """The columns in as few parts as fit into `width`, in their order. Each part has those that name the row."""
    repeated = [i for i in shown if i in names]
    room = width - sum(widths[i] + 2 for i in repeated)
    parts = list[list[int]]([[]])
    for i in (i for i in shown if i not in names):
        if parts[-1] and sum(widths[j] + 2 for j in (*parts[-1], i)) > room:
            parts.append([])
        parts[-1].append(i)
    return [sorted([*repeated, *part]) for part in parts]
