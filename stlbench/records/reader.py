"""Reads a ledger row by row. A damaged part is named in a warning, and skipped."""

from __future__ import annotations

import sqlite3
import warnings
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple, Self

from stlbench.errors import UsageError, one_line
from stlbench.records.identity import CellId
from stlbench.records.result import Result, plain
from stlbench.records.rows import Row, cell_of, result_of
from stlbench.records.schema import COLUMNS, LISTED, VERSION, is_sqlite, opened

_BYTES = 200  # the least that a row takes, in any table
_AGAIN = 10**6
"""Rows that were replaced, at most; each gets a greater number. A damaged file may claim a number of 2^62."""

_OTHER = "its columns do not say what its result says"


class LedgerWarning(UserWarning):
    """A part of a ledger is damaged; the others can be read."""


class Recorded(NamedTuple):
    """One row, with its result or its damage."""

    key: str
    cell: CellId | None  # None if it cannot be read
    files: Mapping[str, str]  # checksums of the cell's files
    result: Result | str  # a text says what is wrong with the row
    again: bool = False  # whether the next run measures the cell
    own_key: str = ""  # the key of its result, if its columns are damaged


class Records:
    """The rows and the plan of a ledger, as a context manager. A missing file has no rows, if `create` allows that.

    Raises `UsageError` if the file is something else, or was written by another version.
    """

    def __init__(self, path: Path, *, create: bool = True) -> None:
        self.path = path
        self._database: sqlite3.Connection | None = None
        if (path.exists() and not path.is_file()) or (path.is_file() and path.stat().st_size and not is_sqlite(path)):
            raise UsageError(f"{path} is no ledger of stlbench; it is left as it is")
        if path.exists():
            self._database = opened(path)
        elif not create:
            raise UsageError(f"there is no ledger at {path}; `stlbench run` writes one")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def close(self) -> None:
        if self._database is not None:
            self._database.close()

    def planned(self) -> dict[str, CellId]:
        return self._cells("planned", "the plan")

    def written(self) -> dict[str, CellId]:
        """The cells of all rows that were written and not removed; none of a ledger of the version before."""
        return self._cells("recorded", "the list of its rows") if self._lists_rows else {}

    @property
    def _lists_rows(self) -> bool:
        tables = "SELECT count(*) FROM sqlite_schema WHERE name = 'recorded'"
        return self._database is not None and bool(_first(self._database.execute(tables)))

    def _cells(self, table: str, what: str) -> dict[str, CellId]:
        if self._database is None:
            return {}
        salvaged, cells = salvage(self._database, table, COLUMNS), dict[str, CellId]()
        for _, key, *identity in salvaged.rows:
            try:
                cells[key] = cell_of(*identity)
            except ValueError as error:
                self._warn(f"a part of {what}", str(error))
        if salvaged.problem:
            self._warn(f"a part of {what}", salvaged.problem)
        return cells

    def problems(self) -> list[str]:
        """SQLite's report about the file's structure; empty if it is whole."""
        if self._database is None:
            return []
        try:
            reports = [str(row[0]) for row in self._database.execute("PRAGMA integrity_check(20)")]
            if not self._lists_rows and _first(self._database.execute("PRAGMA user_version")) >= VERSION:
                reports.append("it does not list the rows that were recorded")
        except sqlite3.DatabaseError as error:
            return [str(error)]
        return [line for text in reports for line in text.splitlines() if line != "ok"]

    def recorded(self) -> Iterator[Recorded]:
        """Every row that can be read, whatever it holds, one at a time."""
        if self._database is not None:
            for columns in salvage(self._database, "cells", LISTED).rows:
                yield self._recorded(*columns)

    def _recorded(self, number: int, key: str, *columns: Any) -> Recorded:
        row, again = _row(number, key, *columns), bool(columns[2])
        try:
            result, files = self._content(number, key)
        except (sqlite3.DatabaseError, ValueError) as error:
            text = one_line(str(error).splitlines()[0])
            return Recorded(key, row.cell if row else None, {}, text, again=again)
        if row is None or not row.is_of(result):
            return Recorded(key, result.id, {}, _OTHER, again, result.key)
        return Recorded(key, result.id, files, result, again)

    def lost(self) -> dict[str, CellId | None]:
        """The keys of rows that cannot be read, with their cells if the plan or the list of rows has them."""
        if self._database is None:
            return {}
        known = self.planned() | self.written()
        return {key: known.get(key) for key in salvage(self._database, "cells", LISTED).lost.values()}

    def listed(self, *, from_index: bool = True) -> list[Row]:
        """All readable rows in the order in which they were recorded.

        `from_index` reads the index, which is far shorter than the table. Damage of the table alone is then seen when a
        result is read.
        """
        if self._database is None:
            return []
        salvaged, rows = salvage(self._database, "cells", LISTED, from_index=from_index), list[Row]()
        for columns in salvaged.rows:
            try:
                rows.append(Row.of(*columns))
            except ValueError as error:
                self._warn(f"the row of the cell with key {columns[1]}", str(error))
        planned = self.planned() if salvaged.lost else {}
        for key in salvaged.lost.values():
            name = planned[key].name if key in planned else f"the cell with key {key}"
            self._warn(f"the row of {name}", salvaged.problem)
        if salvaged.problem and not salvaged.lost:
            self._warn("a part of its rows", salvaged.problem)
        return rows

    def read(self, row: Row) -> Result | None:
        """The result of a row; None, with a warning, if it is damaged."""
        try:
            result, _ = self._content(row.number, row.key)
            problem = "" if row.is_of(result) else _OTHER
        except (sqlite3.DatabaseError, ValueError) as error:
            problem = str(error)
        if problem:
            self._warn(f"the row of {row.cell.name}", problem)
            return None
        return result

    def _content(self, number: int, key: str) -> tuple[Result, Mapping[str, str]]:
        """A row's result and the checksums of its files. Raises `DatabaseError` or `ValueError` if it is damaged."""
        assert self._database is not None
        query = "SELECT result, checksum, files FROM cells WHERE rowid = ? AND key = ?"
        if (found := self._database.execute(query, (number, key)).fetchone()) is None:
            raise ValueError("it is not where the index has it")
        text, checksum, files = found
        checksums = plain(files)
        if not isinstance(checksums, dict):
            raise ValueError(f"checksums of its files are an object, got {files!r:.80}")
        return result_of(text, checksum), checksums

    def columns(self, row: Row) -> dict[str, Any]:
        assert self._database is not None
        try:
            salvaged = self._database.execute("SELECT * FROM cells WHERE rowid = ?", (row.number,))
            return dict(zip([column[0] for column in salvaged.description], salvaged.fetchone(), strict=True))
        except sqlite3.DatabaseError:
            return {}

    def _warn(self, what: str, problem: str) -> None:
        way = f"`stlbench verify {self.path.parent} --repair` has it measured again"
        cause = one_line(problem.splitlines()[0])
        text = f"{self.path}: {one_line(what)} is damaged and passed over; {way} ({cause})"
        warnings.warn(text, LedgerWarning, stacklevel=3)


def _row(number: int, key: str, *columns: Any) -> Row | None:
    try:
        return Row.of(number, key, *columns)
    except ValueError:
        return None


class Salvaged(NamedTuple):
    rows: list[tuple[Any, ...]]  # the row's number, and the columns of the query
    lost: dict[int, str]  # number -> key of rows that exist and cannot be read; empty if the key is unknown
    problem: str  # SQLite's error; empty if nothing is damaged


def salvage(database: sqlite3.Connection, table: str, columns: str, *, from_index: bool = False) -> Salvaged:
    """Read a table in the order of its numbers; a damaged one row by row.

    `from_index` reads an index that has all these columns, which is shorter than the table. It does not see damage of
    the table alone.
    """
    query = f"SELECT rowid, {columns} FROM {table} NOT INDEXED"  # noqa: S608
    try:
        if from_index:
            return Salvaged(sorted(_read(database, query.removesuffix(" NOT INDEXED")), key=itemgetter(0)), {}, "")
        return Salvaged(list(_read(database, query)), {}, "")
    except sqlite3.DatabaseError as error:
        problem = str(error)
    keys = _keys(database, table)
    salvaged, lost = list[tuple[Any, ...]](), dict[int, str]()

    def one_by_one() -> Iterator[tuple[Any, ...]]:
        for number in keys or range(1, _bound(database, table) + 1):
            try:
                yield from database.execute(f"{query} WHERE rowid = ?", (number,)).fetchall()
            except sqlite3.DatabaseError:
                lost[number] = keys.get(number, "")

    with suppress(sqlite3.DatabaseError):
        for row in _within(one_by_one(), _size(database)):
            salvaged.append(row)
    return Salvaged(salvaged, lost if keys else {}, problem)


def _read(database: sqlite3.Connection, query: str) -> Iterator[tuple[Any, ...]]:
    return _within(database.execute(query), _size(database))


def _within(rows: Iterable[tuple[Any, ...]], room: int) -> Iterator[tuple[Any, ...]]:
    """Raises `DatabaseError` after so many bytes: damaged pages can repeat a row for ever."""
    for row in rows:
        room -= sum(len(value) if isinstance(value, str | bytes) else 1 for value in row)
        if room < 0:
            raise sqlite3.DatabaseError("its rows say more than the file holds")
        yield row


def _keys(database: sqlite3.Connection, table: str) -> dict[int, str]:
    """Number -> key of all rows, from the index, which has other pages; empty if that is damaged too."""
    query = f"SELECT rowid, key FROM {table} INDEXED BY sqlite_autoindex_{table}_1"  # noqa: S608
    try:
        return dict(_read(database, query))
    except sqlite3.DatabaseError:
        return {}


def _bound(database: sqlite3.Connection, table: str) -> int:
    most = _size(database) // _BYTES
    try:
        return min(_first(database.execute(f"SELECT max(rowid) FROM {table}")), most + _AGAIN)  # noqa: S608
    except sqlite3.DatabaseError:
        return most


def _size(database: sqlite3.Connection) -> int:
    pages, size = (_first(database.execute(f"PRAGMA {name}")) for name in ("page_count", "page_size"))
    return pages * size


def _first(rows: Iterable[tuple[Any, ...]]) -> int:
    return next((int(row[0] or 0) for row in rows), 0)
