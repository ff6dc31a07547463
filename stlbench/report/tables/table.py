"""A table of values. Its columns say how they are rounded and laid out, and `formats` does it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeVar

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
