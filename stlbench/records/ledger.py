"""The ledger: one SQLite file, one row and one transaction per cell. Only the parent process writes."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from stlbench.errors import unwritable
from stlbench.records.identity import IDENTITY, CellId
from stlbench.records.reader import Records
from stlbench.records.result import Result
from stlbench.records.rows import Row, texts, values
from stlbench.records.schema import open_to_write
from stlbench.records.status import ACCIDENTS, Status

FILE = "ledger.sqlite"
"""Its name in a folder of results."""

_IDENTITY = ", ".join(IDENTITY)


class Ledger(Records):
    """A file of results, as a context manager.

    Columns beside the JSON of `result` are there for SQL: `sqlite3 ledger.sqlite "select * from cells"`.

    Args:
        path: the file. Where there is none, it is made, with the folders above it, when something is first written.
        create: whether that is so. A reader says False and gets a `UsageError` instead.

    What is only read needs no right to write. There is one file: what is recorded is in no other beside it. A part that
    is damaged is named, as a `LedgerWarning`, and passed over.

    Raises:
        UsageError: the file is something else, or was written by a newer version.
    """

    def __init__(self, path: Path, *, create: bool = True) -> None:
        super().__init__(path, create=create)
        self._is_writing, self._own = False, (0, 0)

    # ----------------------------------------------------------------------------------------------------- writing

    def plan(self, cells: Mapping[str, CellId]) -> None:
        """Write which cells a study has, by key, in place of earlier plans for the same settings."""
        settings = {
            (str(cell.task), str(cell.method), str(cell.agent), cell.budget, cell.track) for cell in cells.values()
        }
        with self._writing() as database:
            database.executemany(
                "DELETE FROM planned WHERE (task, method, agent, budget, track) = (?, ?, ?, ?, ?)", sorted(settings)
            )
            _add_plan(database, cells)

    def plan_also(self, cells: Mapping[str, CellId]) -> None:
        """Write which further cells a study has, by key."""
        with self._writing() as database:
            _add_plan(database, cells)

    def record(self, result: Result) -> None:
        """Write one result, in place of one with the same key, with checksums of its files. On return it is on disk."""
        with self._writing() as database:
            before = database.execute("SELECT failures FROM cells WHERE key = ?", (result.key,)).fetchone()
            failures = (before[0] if before else 0) + 1 if result.status in ACCIDENTS else 0
            _insert(database, values(result, self.path.parent, failures))

    def mark(self, key: str, own: str) -> None:
        """Have the cell with this key measured again. Its result counts until there is another.

        `own` is the key that its result says; a row with another one gets it, unless there is one that has it.
        """
        with self._writing() as database:
            database.execute("UPDATE OR IGNORE cells SET again = 1, key = ? WHERE key = ?", (own, key))
            if own != key:
                database.execute("DELETE FROM cells WHERE key = ?", (key,))

    def copy(self, source: Ledger) -> None:
        """Take over the plan and the rows of another ledger, as they are, as far as they can be read."""
        self.plan_also(source.planned())
        with self._writing() as database:
            for row in source.listed(from_index=False):
                _insert(database, source.columns(row))

    def remove(self, cell: CellId) -> list[str]:
        """Take a cell out, with all its results, older ones too, and its place in the plan; the keys it had."""
        keys = list[str]()
        with self._writing() as database:
            for table in ("cells", "planned"):
                rows = database.execute(
                    f"DELETE FROM {table} WHERE ({_IDENTITY}) = (?, ?, ?, ?, ?, ?) RETURNING key",  # noqa: S608
                    texts(cell),
                )
                keys += [key for (key,) in rows]
        return list(dict.fromkeys(keys))

    @property
    def is_meddled(self) -> bool:
        """Whether anything else has written in the file, or put another in its place, since this began to write."""
        return self._is_writing and self._own != self._seen()

    def _seen(self) -> tuple[int, int]:
        """SQLite's number of what other connections have written, and the number of the file."""
        assert self._database is not None
        ((version,),) = self._database.execute("PRAGMA data_version")
        return version, self.path.stat().st_ino if self.path.exists() else 0

    # ----------------------------------------------------------------------------------------------------- reading

    def finished(self, keys: Iterable[str], retry: Collection[Status] = (), attempts: int | None = None) -> set[str]:
        """Those of the keys that have a row, and are not to be measured again.

        Args:
            keys: of cells.
            retry: how cells ended that are to be tried again; then those too whose row is damaged.
            attempts: a cell that failed so often in a row is given up, and finished; None is never.
        """
        rows = {row.key: row for row in self.listed()}
        rows_of_keys = [rows[key] for key in keys if key in rows and not rows[key].again]
        if retry:
            again = {row.key for row in rows_of_keys if row.status in retry and not _is_given_up(row, attempts)}
            rows_of_keys = [row for row in rows_of_keys if row.key not in again and self.read(row) is not None]
        return {row.key for row in rows_of_keys}

    def given_up(self, keys: Collection[str], attempts: int) -> list[CellId]:
        """The cells, of those with these keys, that failed so often in a row."""
        wanted = frozenset(keys)
        return sorted(row.cell for row in self.listed() if row.key in wanted and _is_given_up(row, attempts))

    def missing(self) -> list[CellId]:
        """The cells that were planned and have no result, ordered."""
        return sorted(set(self.planned().values()) - {row.cell for row in self.listed()})

    def results(self, keys: Collection[str] | None = None) -> Iterator[Result]:
        """The results with these keys, or one of every cell, ordered by task, method, agent and seed.

        A plugin that was edited has other keys. Of a cell that has several results, the one counts that was planned
        last, else the newest. A row that is damaged is passed over, with a `LedgerWarning`.
        """
        rows = self.listed()
        chosen = {row.key for row in self._present(rows)} if keys is None else frozenset(keys)
        for row in sorted(rows, key=lambda row: (texts(row.cell)[:4], row.key)):
            if row.key in chosen and (result := self.read(row)) is not None:
                yield result

    def results_of(self, cells: Iterable[CellId]) -> Iterator[Result]:
        """Of each of these cells the result that counts, in the order of `results`."""
        counted = self.counted()
        return self.results({counted[cell] for cell in cells if cell in counted})

    def present(self) -> dict[CellId, Row]:
        """Of each cell that has a result the row of the one that counts, for `read`."""
        return {row.cell: row for row in self._present(self.listed())}

    def counted(self, *, accidents: bool = True) -> dict[CellId, str]:
        """Of each cell that has a result the key of the one that counts; of those that ended by an accident too."""
        present = self._present(self.listed())
        return {row.cell: row.key for row in present if accidents or row.status not in ACCIDENTS}

    def _present(self, rows: Iterable[Row]) -> Collection[Row]:
        """Of each cell the row that was planned last, else the newest."""
        planned = self.planned()
        return {row.cell: row for row in sorted(rows, key=lambda row: (row.key in planned, row.number))}.values()

    # ----------------------------------------------------------------------------------------------------- opening

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """A transaction, in a file that is made where there is none."""
        if not self._is_writing:
            self.close()
            self._database = open_to_write(self.path)
            self._is_writing, self._own = True, self._seen()
        assert self._database is not None
        try:
            with self._database as database:
                database.execute("BEGIN IMMEDIATE")
                yield database
        except sqlite3.DatabaseError as error:
            failure = unwritable(f"cannot write the ledger {self.path}", error)
            raise type(failure)(f"{failure}{_way_out(error, self.path)}") from error


def _add_plan(database: sqlite3.Connection, cells: Mapping[str, CellId]) -> None:
    columns, marks = f"key, {_IDENTITY}", ", ".join("?" * (1 + len(IDENTITY)))
    rows = [(key, *texts(cell)) for key, cell in cells.items()]
    database.executemany(f"INSERT OR REPLACE INTO planned ({columns}) VALUES ({marks})", rows)  # noqa: S608


def _insert(database: sqlite3.Connection, columns: Mapping[str, Any]) -> None:
    names, marks = ", ".join(columns), ", ".join("?" * len(columns))
    if columns:
        database.execute(f"INSERT OR REPLACE INTO cells ({names}) VALUES ({marks})", tuple(columns.values()))  # noqa: S608


def _is_given_up(row: Row, attempts: int | None) -> bool:
    return attempts is not None and row.failures >= attempts


def _way_out(error: sqlite3.DatabaseError, path: Path) -> str:
    damaged = getattr(error, "sqlite_errorcode", 0) in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
    return f"; `stlbench verify {path.parent} --repair` keeps what can be read" if damaged else ""
