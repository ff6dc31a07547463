"""The rows of a SQLite file of which a part is damaged: those that can be read, one by one."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable
from operator import itemgetter
from typing import Any, NamedTuple

__all__ = ["Salvaged", "salvage"]

_BYTES = 200
"""A row takes at least so many, in all tables of a ledger."""


class Salvaged(NamedTuple):
    """What could be read of a table."""

    rows: list[tuple[Any, ...]]
    """Its number, and the columns that were asked for."""
    lost: dict[int, str]
    """Of rows that are known and cannot be read: number -> key, empty where that is not known either."""
    problem: str
    """What SQLite says of it; empty where nothing is damaged."""


def salvage(database: sqlite3.Connection, table: str, columns: str, *, from_index: bool = False) -> Salvaged:
    """Read a table in the order of its numbers, all at once where it is not damaged.

    `from_index` reads an index that has all these columns where there is one, which is shorter than the table; what is
    damaged of the table alone is not seen then.
    """
    query = f"SELECT rowid, {columns} FROM {table} NOT INDEXED"  # noqa: S608
    try:
        if from_index:
            return Salvaged(sorted(database.execute(query.removesuffix(" NOT INDEXED")), key=itemgetter(0)), {}, "")
        return Salvaged(database.execute(query).fetchall(), {}, "")
    except sqlite3.DatabaseError as error:
        problem = str(error)
    keys = _keys(database, table)
    found, lost = list[tuple[Any, ...]](), dict[int, str]()
    for number in keys or range(1, _bound(database, table) + 1):
        try:
            found += database.execute(f"{query} WHERE rowid = ?", (number,)).fetchall()
        except sqlite3.DatabaseError:
            lost[number] = keys.get(number, "")
    return Salvaged(found, lost if keys else {}, problem)


def _keys(database: sqlite3.Connection, table: str) -> dict[int, str]:
    """Number -> key of all rows, of the index, which is in other pages; nothing where that is damaged itself."""
    query = f"SELECT rowid, key FROM {table} INDEXED BY sqlite_autoindex_{table}_1"  # noqa: S608
    try:
        return dict(database.execute(query))
    except sqlite3.DatabaseError:
        return {}


def _bound(database: sqlite3.Connection, table: str) -> int:
    """No row has a greater number, unless much was written again."""
    try:
        return _first(database.execute(f"SELECT max(rowid) FROM {table}"))  # noqa: S608
    except sqlite3.DatabaseError:
        pages, size = (_first(database.execute(f"PRAGMA {name}")) for name in ("page_count", "page_size"))
        return pages * size // _BYTES


def _first(rows: Iterable[tuple[Any, ...]]) -> int:
    return next((int(row[0] or 0) for row in rows), 0)
