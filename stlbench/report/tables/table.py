"""One table of values, in several formats: Markdown, LaTeX and the terminal are rounded and laid out as its columns
say; CSV and records have all digits.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Literal, NamedTuple, TypeVar

from rich import box
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text

from stlbench.records.result_files import csv_text
from stlbench.statistics.intervals import Interval

Width = Literal["column", "page"]
"""The width that a table or a figure of a paper fits: one column of two (3.5 inches), or the page (7.16 inches)."""
NOTHING = "-"  # what is shown where there is nothing to show


def decimal(value: float | None, digits: int | None = 3) -> str:
    """A number with so many decimals, never "-0.000"; None means six significant digits."""
    if value is None:
        return NOTHING
    text = f"{value:.6g}" if digits is None else f"{value:.{digits}f}"
    return text.removeprefix("-") if math.isfinite(value) and float(text) == 0 else text


class Seeds(NamedTuple):
    done: int
    planned: int
    unfinished: str | None = None  # how the others ended: "1 timeout"


class Share(NamedTuple):
    """Seeds that learned, of those that ran."""

    number: int
    seeds: int
    others: str | None = None  # how those without a result ended: "1 timeout"


class FirstFailed(NamedTuple):
    """The conjunct that most often failed first, among starts that violate the formula."""

    formula: str
    starts: int  # that failed it first
    violating_starts: int


class Learned(NamedTuple):
    """Median of the selected policies' robustness with its interval, None where there is none; and on how many seeds
    they, and the final ones, learned the task."""

    robustness: float
    low: float | None
    high: float | None
    learned: int
    final_learned: int
    seeds: int
    mark: str = ""  # some of the characters *, = and ~


Plain = float | int | str | None  # what CSV and JSON have
Compound = Interval | Seeds | Share | FirstFailed | Learned
"""Shown as one, and in CSV and JSON one column for each part."""
Value = Plain | Compound
_T = TypeVar("_T")


@dataclass(frozen=True)
class Column:
    """A column: what its values are, and how they are shown."""

    title: str
    short: str = ""  # the title on screen, where it may be shorter
    unit: str = ""
    digits: int | None = None
    """Decimals that are shown; None for six significant digits. CSV and JSON have all."""
    kind: type[Compound] | None = None  # of compound values
    right: bool = True  # aligned to the right, as numbers are
    drop: int = 0
    """A narrow screen drops columns from the highest number down; 0 always stays. Files have all columns."""
    shared: bool = False  # on screen, moves into the title where all rows say the same
    below: bool = False  # long text: on screen it is a line under the table

    @property
    def heading(self) -> str:
        """Title and unit: training CPU [s]."""
        return self._with_unit(self.title)

    @property
    def header(self) -> str:
        """The heading on screen."""
        return self._with_unit(self.short or self.title)

    @property
    def headings(self) -> tuple[str, ...]:
        """The headings in CSV and JSON."""
        if self.kind is None:
            return (self.heading,)
        return tuple(self._with_unit(f"{self.title} {part.replace('_', ' ')}") for part in self.kind._fields)

    def _with_unit(self, title: str) -> str:
        return f"{title} [{self.unit}]" if self.unit else title


@dataclass(frozen=True)
class Table:
    """Values in rows, each as long as `columns`."""

    title: str
    columns: tuple[Column, ...]
    rows: tuple[tuple[Value, ...], ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        title: str,
        items: Iterable[_T],
        columns: Mapping[Column, Callable[[_T], Value]],
        notes: tuple[str, ...] = (),
    ) -> Table:
        """A row for each item. Each column comes with the function that gives its value for an item."""
        rows = tuple(tuple(value(item) for value in columns.values()) for item in items)
        return cls(title, tuple(columns), rows, notes)

    @property
    def shared(self) -> list[int]:
        return [i for i, column in enumerate(self.columns) if column.shared]

    @property
    def alike(self) -> list[int]:
        """The shared columns in which all rows have the same value."""
        return [i for i in self.shared if len({row[i] for row in self.rows}) == 1]

    def split(self, place: int) -> Iterator[Table]:
        """A table for each value of a column."""
        for value in dict.fromkeys(row[place] for row in self.rows):
            yield replace(self, rows=tuple(row for row in self.rows if row[place] == value))

    def title_with(self, places: Iterable[int]) -> str:
        """The title, with what the first row says in these columns."""
        columns = ((self.columns[i], self.rows[0][i]) for i in places)
        common = ", ".join(f"{column.heading} {show(value, column.digits)}" for column, value in columns)
        return f"{self.title}: {common}" if common else self.title

    def select(self, places: Iterable[int], title: str) -> Table:
        """These columns alone, under another title."""
        chosen = list(places)
        rows = tuple(tuple(row[i] for i in chosen) for row in self.rows)
        return Table(title, tuple(self.columns[i] for i in chosen), rows, self.notes)

    def trimmed(self, *, folded: bool = False) -> Table:
        """Without empty columns. If `folded`, what all rows share goes into the title, as on a screen."""
        shown = [i for i, values in enumerate(zip(*self.rows, strict=True)) if any(v not in (None, "") for v in values)]
        alike = [i for i in shown if folded and i in self.alike]
        return self.select((i for i in shown if i not in alike), self.title_with(alike)) if self.rows else self


def show(value: Value, digits: int | None = None) -> str:
    """A value for people, rounded. The interval of what was learned has a line of its own."""
    match value:
        case Interval(low, high):
            return f"[{decimal(low, digits)}, {decimal(high, digits)}]"
        case Seeds(done, planned, unfinished):
            return f"{done} of {planned}, {unfinished}" if unfinished else f"{done} of {planned}"
        case Share(number, seeds, others):
            return ", ".join([*([f"{number} of {seeds}"] if seeds else []), *([others] if others else [])]) or NOTHING
        case FirstFailed(formula, starts, violating):
            return f"{formula} ({decimal(100 * starts / violating, 0)} % of {violating} violating starts)"
        case Learned(robustness, low, high, learned, final, seeds, mark):
            text = f"{decimal(robustness, digits)} ({learned}, {final} of {seeds}) {mark}".rstrip()
            return text if low is None or high is None else f"{text}\n{show(Interval(low, high), digits)}"
        case float():
            return decimal(value, digits)
        case None:
            return NOTHING
    return str(value)


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
"""Characters of 3.95 points, as 8-point text takes them with the space between columns.

A column of IEEE has 252 points, a page 516."""
_LINES = 60  # of 9.5 points, on a page of IEEE, with its caption
_TEXT = 16  # characters of a line of text in a column that is no wider than necessary
_Lines = Sequence[str]  # of one value
_Row = Sequence[_Lines]


def to_markdown(table: Table) -> str:
    """A section: heading, table with padded columns, notes, which may have Markdown but no HTML."""
    columns, texts = table.columns, [[column.heading for column in table.columns], *_texts(table)]
    header, *body = [[_MARKDOWN.sub(r"\\\1", " ".join(text.split())) for text in line] for line in texts]
    widths = [max(3, *map(len, texts)) for texts in zip(header, *body, strict=True)]
    rule = ["-" * (width - 1) + (":" if column.right else "-") for width, column in zip(widths, columns, strict=True)]
    lines = [f"## {table.title}", ""]
    for line in (header, rule, *body):
        cells = zip(line, widths, columns, strict=True)
        padded = [text.rjust(width) if column.right else text.ljust(width) for text, width, column in cells]
        lines.append(f"| {' | '.join(padded)} |")
    return "\n".join([*lines, "", *(f"- {note.replace('<', '&lt;')}" for note in table.notes)]) + "\n"


def _texts(table: Table) -> list[list[str]]:
    return [
        [show(value, column.digits) for value, column in zip(row, table.columns, strict=True)] for row in table.rows
    ]


def to_csv(table: Table) -> str:
    """Header and rows in full, without title and notes; None is an empty field."""
    return csv_text([_headings(table), *_plain(table)])


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
    columns, rows = table.columns, _texts(table)
    heads = [textwrap.wrap(each.header, 12, break_long_words=False, break_on_hyphens=False) for each in columns]
    lines = [[_wrapped(text, column) for text, column in zip(row, columns, strict=True)] for row in rows]
    widths = [max(len(line) for cell in cells for line in cell) for cells in zip(heads, *lines, strict=True)]
    fit = _fit(table, rows, widths, _CHARACTERS[width])
    varying = [i for i in table.shared if i not in table.alike]
    if varying and any(sum(widths[i] + 2 for i in part) > _CHARACTERS[width] for part in fit.parts):
        parts = [replace(part, notes=()) for part in table.split(varying[0])]  # one for each task, say
        notes = [f"% {' '.join(note.split())}" for note in table.notes]
        return "\n".join([*notes, *(to_latex(part, width) for part in parts)])
    left_out = [f"Left out: {fit.left_out}."] if fit.left_out else []
    comments = [f"% {' '.join(line.split())}" for line in (fit.title, *left_out, *fit.remarks, *table.notes)]
    tabulars = [_tabular(columns, heads, some, part) for part in fit.parts for some in _pages(lines, part)]
    return "\n".join([*comments, "\n\n".join(tabulars), ""])


def _wrapped(text: str, column: Column) -> list[str]:
    """The lines of a value: words stay whole, and so do numbers."""
    lines = text.splitlines() if column.right else textwrap.wrap(text, _TEXT, break_long_words=False)
    return lines or [""]


def _pages(rows: Sequence[_Row], part: Sequence[int]) -> Iterator[list[_Row]]:
    """The rows of each tabular, at most as many lines as a page takes."""
    page, height = list[_Row](), 0
    for row in rows:
        needs = max(len(row[i]) for i in part)
        if page and height + needs > _LINES:
            yield page
            page, height = [], 0
        page.append(row)
        height += needs
    yield page


def _tabular(columns: Sequence[Column], heads: Sequence[_Lines], rows: Iterable[_Row], part: Sequence[int]) -> str:
    sides = {i: "r" if columns[i].right else "l" for i in part}
    head = " & ".join(_latex_cell(heads[i], sides[i], "b") for i in part)
    body = [" & ".join(_latex_cell(row[i], sides[i], "t") for i in part) for row in rows]
    return "\n".join(
        [
            r"{\fontsize{8}{9.5}\selectfont\setlength{\tabcolsep}{3pt}%",
            rf"\begin{{tabular}}{{@{{}}{''.join(sides.values())}@{{}}}}",
            r"\toprule",
            rf"{head} \\",
            r"\midrule",
            *(rf"{line} \\" for line in body),
            r"\bottomrule",
            r"\end{tabular}}",
        ]
    )


def _latex_cell(lines: _Lines, side: str, place: str) -> str:
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
    """Print the table as wide as the console. A value that all rows share goes into the title, long texts go below.

    A table that is too wide loses columns. One without such columns comes in parts, one below the other. To `explain`,
    a line names the columns that are left out, and notes follow.
    """
    columns, rows = table.columns, _texts(table)
    widths = [_least(column, [row[i] for row in rows]) for i, column in enumerate(columns)]
    fit = _fit(table, rows, widths, console.width)
    console.print(Text(fit.title, style="bold"))
    for part in fit.parts:
        laid_out = RichTable(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
        for i in part:
            shape: Any = {"justify": "right", "width": widths[i]} if columns[i].right else {"overflow": "fold"}
            laid_out.add_column(Text(columns[i].header), **shape)
        for row in rows:
            laid_out.add_row(*(Text(row[i]) for i in part))
        console.print(laid_out)
        console.print()
    left_out = [f"Left out on this narrow screen: {fit.left_out}."] if fit.left_out else []
    notes = [*left_out, *table.notes] if explain else []
    for line in [*(Text(remark) for remark in fit.remarks), *(Text(note, style="dim") for note in notes)]:
        console.print(line)
    if fit.remarks or notes:
        console.print()


def _least(column: Column, texts: Sequence[str]) -> int:
    """The width at which a column still reads well: numbers unbroken, texts and headers broken between words."""
    longest = max((len(line) for text in texts for line in text.splitlines()), default=0)
    return max(*map(len, column.header.split()), longest if column.right else min(longest, _TEXT))


class _Fit(NamedTuple):
    title: str  # with what all rows share
    parts: list[list[int]]  # columns that are printed in one line
    left_out: str
    remarks: list[str]  # the long texts


def _fit(table: Table, rows: Sequence[Sequence[str]], widths: Sequence[int], width: int) -> _Fit:
    """Choose the columns of these widths that fit into `width` characters; `rows` are the values as they are shown."""
    columns, alike = table.columns, table.alike
    inside = [i for i, column in enumerate(columns) if i not in alike and not column.below]
    shown = list(inside)
    while sum(widths[i] + 2 for i in shown) > width and any(columns[i].drop for i in shown):
        shown.remove(max(reversed(shown), key=lambda i: columns[i].drop))
    names = [i for i, column in enumerate(columns) if column.shared or column.title == "method"]
    return _Fit(
        title=table.title_with(alike),
        parts=_parts(shown, names, widths, width),
        left_out=", ".join(columns[i].heading for i in inside if i not in shown),
        remarks=[
            f"{column.title}: {'/'.join(row[j] for j in names)}: {row[i]}"
            for i, column in enumerate(columns)
            if column.below
            for row in rows
            if row[i] != NOTHING
        ],
    )


def _parts(shown: Sequence[int], names: Sequence[int], widths: Sequence[int], width: int) -> list[list[int]]:
    """The columns in as few parts as fit into `width`, in their order. Each part has those that name the row."""
    repeated = [i for i in shown if i in names]
    room = width - sum(widths[i] + 2 for i in repeated)
    parts = list[list[int]]([[]])
    for i in (i for i in shown if i not in names):
        if parts[-1] and sum(widths[j] + 2 for j in (*parts[-1], i)) > room:
            parts.append([])
        parts[-1].append(i)
    return [sorted([*repeated, *part]) for part in parts]
