"""The rows of a SQLite file of which a part is damaged: those that can be read, one by one."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import suppress
from operator import itemgetter
from typing import Any, NamedTuple

_BYTES = 200
"""A row takes at least so many, in all tables of a ledger."""
_AGAIN = 10**6
"""Rows that were written again, at most; each gets a greater number. A number that a file only claims may be 2^62."""


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
            return Salvaged(sorted(_read(database, query.removesuffix(" NOT INDEXED")), key=itemgetter(0)), {}, "")
        return Salvaged(list(_read(database, query)), {}, "")
    except sqlite3.DatabaseError as error:
        problem = str(error)
    keys = _keys(database, table)
    found, lost = list[tuple[Any, ...]](), dict[int, str]()

    def one_by_one() -> Iterator[tuple[Any, ...]]:
        for number in keys or range(1, _bound(database, table) + 1):
            try:
                yield from database.execute(f"{query} WHERE rowid = ?", (number,)).fetchall()
            except sqlite3.DatabaseError:
                lost[number] = keys.get(number, "")

    with suppress(sqlite3.DatabaseError):
        for row in _within(one_by_one(), _size(database)):
            found.append(row)
    return Salvaged(found, lost if keys else {}, problem)


def _read(database: sqlite3.Connection, query: str) -> Iterator[tuple[Any, ...]]:
    return _within(database.execute(query), _size(database))


def _within(rows: Iterable[tuple[Any, ...]], room: int) -> Iterator[tuple[Any, ...]]:
    """Raises `DatabaseError` where rows say more than so many bytes: pages that point to pages can repeat a row for
    ever."""
    for row in rows:
        room -= sum(len(value) if isinstance(value, str | bytes) else 1 for value in row)
        if room < 0:
            raise sqlite3.DatabaseError("its rows say more than the file holds")
        yield row


def _keys(database: sqlite3.Connection, table: str) -> dict[int, str]:
    """Number -> key of all rows, of the index, which is in other pages; nothing where that is damaged itself."""
    query = f"SELECT rowid, key FROM {table} INDEXED BY sqlite_autoindex_{table}_1"  # noqa: S608
    try:
        return dict(_read(database, query))
    except sqlite3.DatabaseError:
        return {}


def _bound(database: sqlite3.Connection, table: str) -> int:
    """No row has a greater number, unless very much was written again."""
    most = _size(database) // _BYTES
    try:
        return min(_first(database.execute(f"SELECT max(rowid) FROM {table}")), most + _AGAIN)  # noqa: S608
    except sqlite3.DatabaseError:
        return most


def _size(database: sqlite3.Connection) -> int:
    """Bytes of the file."""
    pages, size = (_first(database.execute(f"PRAGMA {name}")) for name in ("page_count", "page_size"))
    return pages * size


def _first(rows: Iterable[tuple[Any, ...]]) -> int:
    return next((int(row[0] or 0) for row in rows), 0)
