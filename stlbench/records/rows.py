"""The rows of a ledger, with checksums; a ledger read row by row, of which a damaged part is named in a warning, and
skipped.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
import warnings
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from operator import itemgetter
from pathlib import Path
from typing import Any, NamedTuple, Self

from stlbench.errors import UsageError, one_line
from stlbench.records.identity import IDENTITY, CellId, Name, ReadCell, Whole, valid
from stlbench.records.result import SCHEMA, Result, Status, from_json, plain, to_json
from stlbench.records.result_files import cell_files, is_there, read
from stlbench.records.schema import COLUMNS, LISTED, VERSION, is_damaged, is_sqlite, opened, unusable


class Row(NamedTuple):
    number: int  # rows that were recorded later have greater numbers
    key: Name
    status: Status
    failures: Whole  # how often in a row the cell has failed
    again: bool  # whether the next run measures the cell
    cell: ReadCell

    @classmethod
    def of(cls, number: int, key: object, status: object, failures: object, again: object, *identity: object) -> Self:
        """The row from a rowid and the columns `LISTED`. Raises `ValueError` if they are damaged."""
        named = dict(zip(IDENTITY, identity, strict=True))
        row: Self = valid(cls, (number, key, status, failures, again, named))
        return row

    def is_of(self, result: Result) -> bool:
        """Whether the columns say what the result says."""
        return (self.key, self.status, self.cell) == (result.key, result.status, result.id)


def cell_of(*identity: object) -> CellId:
    """The cell of the columns `IDENTITY`. Raises `ValueError` if they are damaged."""
    cell: CellId = valid(ReadCell, dict(zip(IDENTITY, identity, strict=True)))
    return cell


def texts(cell: CellId) -> tuple[str | int, ...]:
    """The columns `IDENTITY` of a cell."""
    return tuple(cell.plain.values())


def values(result: Result, folder: Path, failures: int) -> dict[str, str | int | float | None]:
    """Column -> value of the row of a result that is recorded now, in a folder that has its files already."""
    measured, text = result.measurement, to_json(result)
    return {
        "key": result.key,
        **result.id.plain,
        "status": result.status,
        "reason": result.reason,
        **{name: None if measured is None else datum.of(measured) for name, datum in SCHEMA.items() if datum.ledger},
        "recorded_at": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "result": text,
        "checksum": checksum_of(text),
        "files": json.dumps(checksums_beside(folder, result) if measured else {}),
        "failures": failures,
        "again": 0,
    }


def result_of(text: Any, checksum: Any) -> Result:
    if checksum != checksum_of(text):
        raise ValueError("it does not have the checksum that was recorded with it")
    return from_json(text)


def checksum_of(text: Any) -> str:
    return hashlib.sha256(text if isinstance(text, bytes) else str(text).encode()).hexdigest()[:32]


def checksums_beside(folder: Path, result: Result) -> Mapping[str, str]:
    """Name -> SHA-256 (64 hex digits) of the traces and the policies that exist."""
    paths = cell_files(folder, result.id, result.key)
    named = {"traces": paths.traces, "policies": paths.policies}
    there = {name: path for name, path in named.items() if is_there(path, folder)}
    return {name: hashlib.sha256(read(path, folder)).hexdigest() for name, path in there.items()}


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

    Raises `UsageError` if the file is something else, or was written by another version; all that reads it does, if
    SQLite finds it damaged.
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
        cells = dict[str, CellId]()
        for _, key, *identity in self._rows(table, COLUMNS):
            try:
                cells[key] = cell_of(*identity)
            except ValueError as error:
                self._warn(f"a part of {what}", str(error))
        return cells

    def _rows(self, table: str, columns: str, *, from_index: bool = False) -> list[tuple[Any, ...]]:
        """Number and columns of a table's rows, in the order of their numbers.

        `from_index` reads an index that has all these columns, which is far shorter than the table. It does not see
        damage of the table alone.
        """
        if self._database is None:
            return []
        query = f"SELECT rowid, {columns} FROM {table}{'' if from_index else ' NOT INDEXED'}"  # noqa: S608
        try:
            return sorted(_within(self._database.execute(query), _size(self._database)), key=itemgetter(0))
        except sqlite3.DatabaseError as error:
            raise unusable("read", self.path, error) from error

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
        return [line for text in reports for line in text.splitlines() if line != "ok" and not line.startswith("***")]

    def recorded(self) -> Iterator[Recorded]:
        """Every row, whatever it holds, one at a time."""
        for columns in self._rows("cells", LISTED):
            yield self._recorded(*columns)

    def _recorded(self, number: int, key: str, *columns: Any) -> Recorded:
        row, again = _row(number, key, *columns), bool(columns[2])
        content = self._content(number, key)
        if isinstance(content, str):
            return Recorded(key, row.cell if row else None, {}, one_line(content), again=again)
        result, files = content
        if row is None or not row.is_of(result):
            return Recorded(key, result.id, {}, _OTHER, again, result.key)
        return Recorded(key, result.id, files, result, again)

    def listed(self) -> list[Row]:
        """All rows in the order in which they were recorded, but those that no run writes."""
        rows = list[Row]()
        for columns in self._rows("cells", LISTED, from_index=True):
            try:
                rows.append(Row.of(*columns))
            except ValueError as error:
                self._warn(f"the row of the cell with key {columns[1]}", str(error))
        return rows

    def read(self, row: Row) -> Result | None:
        """The result of a row; None, with a warning, if it is damaged."""
        content = self._content(row.number, row.key)
        if not isinstance(content, str) and row.is_of(content[0]):
            return content[0]
        self._warn(f"the row of {row.cell.name}", content if isinstance(content, str) else _OTHER)
        return None

    def _content(self, number: int, key: str) -> tuple[Result, Mapping[str, str]] | str:
        """A row's result and the checksums of its files; or what is wrong with the row."""
        assert self._database is not None
        query = "SELECT result, checksum, files FROM cells WHERE rowid = ? AND key = ?"
        try:
            found = self._database.execute(query, (number, key)).fetchone()
        except sqlite3.DatabaseError as error:
            if is_damaged(error):
                raise unusable("read", self.path, error) from error
            return str(error)
        if found is None:
            return "it is not where the index has it"
        text, checksum, files = found
        try:
            result, checksums = result_of(text, checksum), plain(files)
        except ValueError as error:
            return str(error).splitlines()[0]
        if not isinstance(checksums, dict):
            return f"checksums of its files are an object, got {files!r:.80}"
        return result, checksums

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


def _within(rows: Iterable[tuple[Any, ...]], room: int) -> Iterator[tuple[Any, ...]]:
    """Raises `DatabaseError` after so many bytes: damaged pages can repeat a row for ever."""
    for row in rows:
        room -= sum(len(value) if isinstance(value, str | bytes) else 1 for value in row)
        if room < 0:
            raise sqlite3.DatabaseError("its rows say more than the file holds")
        yield row


def _size(database: sqlite3.Connection) -> int:
    pages, size = (_first(database.execute(f"PRAGMA {name}")) for name in ("page_count", "page_size"))
    return pages * size


def _first(rows: Iterable[tuple[Any, ...]]) -> int:
    return next((int(row[0] or 0) for row in rows), 0)
