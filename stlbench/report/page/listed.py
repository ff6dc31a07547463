"""Tables as the page shows them: texts, and by what a column is sorted."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from stlbench.report.statistics.intervals import Interval
from stlbench.report.tables.table import NOTHING, FirstFailed, Learned, Seeds, Table, Value, show


@dataclass(frozen=True)
class Head:
    """The head of a column."""

    text: str
    right: bool


@dataclass(frozen=True)
class Entry:
    """One value."""

    text: str
    key: float | str | None = None
    """By what it is sorted; None for what there is nothing of, which stands last."""


@dataclass(frozen=True)
class Listed:
    """A table."""

    title: str
    heads: tuple[Head, ...]
    rows: tuple[tuple[Entry, ...], ...]
    notes: tuple[str, ...] = ()

    def content(self) -> dict[str, Any]:
        """As plain values, for a table that the script makes."""
        return {
            "title": self.title,
            "heads": [[head.text, head.right] for head in self.heads],
            "rows": [[entry.text for entry in row] for row in self.rows],
        }


def listed(table: Table, *, folded: bool = False) -> Listed:
    """The same table, without columns in which there is nothing.

    Where it is `folded`, what all rows share goes into the title, as on a screen.
    """
    columns, rows = table.columns, table.rows
    kept = [i for i in range(len(columns)) if not rows or any(row[i] not in (None, "") for row in rows)]
    alike = [i for i in kept if folded and columns[i].shared and len({row[i] for row in rows}) == 1]
    common = ", ".join(f"{columns[i].heading} {show(rows[0][i])}" for i in alike)
    kept = [i for i in kept if i not in alike]
    return Listed(
        title=f"{table.title}: {common}" if common else table.title,
        heads=tuple(Head(columns[i].header, columns[i].right) for i in kept),
        rows=tuple(tuple(_entry(row[i], columns[i].digits) for i in kept) for row in rows),
        notes=table.notes,
    )


def of_rows(table: Table, wanted: Callable[[tuple[Value, ...]], bool]) -> Table:
    """The table with some of its rows."""
    return Table(table.title, table.columns, tuple(filter(wanted, table.rows)), table.notes)


def of_columns(table: Table, titles: Iterable[str]) -> Table:
    """The table with those of its columns that have these titles."""
    names = list(titles)
    kept = [i for i, column in enumerate(table.columns) if column.title in names]
    rows = tuple(tuple(row[i] for i in kept) for row in table.rows)
    return Table(table.title, tuple(table.columns[i] for i in kept), rows, table.notes)


def _entry(value: Value, digits: int | None) -> Entry:
    return Entry(NOTHING if value is None else show(value, digits), _key(value))


def _key(value: Value) -> float | str | None:
    match value:
        case Interval(low, _):
            return low
        case Seeds(done, _, _):
            return done
        case FirstFailed(formula, _, _):
            return formula
        case Learned():
            return value.robustness
        case bool() | int() | float() | str() | None:
            return value
    return None
