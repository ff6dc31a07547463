"""The ledger: one SQLite file, one row and one transaction per cell. Only the parent process writes."""

from __future__ import annotations

import sqlite3
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, Self

from stlbench.contract_parts.texts import one_line
from stlbench.errors import UsageError
from stlbench.registry.choices import parse_choice
from stlbench.result import ACCIDENTS, IDENTITY, CellId, Result, from_json, reported, to_json

__all__ = ["FILE", "VERSION", "Ledger", "LedgerWarning", "is_sqlite"]

FILE = "ledger.sqlite"
"""Its name in a folder of results."""

VERSION = 3
"""Of the tables below, in `PRAGMA user_version`. Version 1 had no plan, version 2 no tracks."""

APPLICATION = int.from_bytes(b"STLB", "big")
"""In `PRAGMA application_id`: tells a ledger from any other SQLite file."""

_IDENTITY = ", ".join(IDENTITY)

_CELLS = """
CREATE TABLE IF NOT EXISTS cells (
    key TEXT PRIMARY KEY, task TEXT NOT NULL, method TEXT NOT NULL, agent TEXT NOT NULL, seed INTEGER NOT NULL,
    budget TEXT NOT NULL, status TEXT NOT NULL, reason TEXT NOT NULL, robustness_mean REAL, satisfaction REAL,
    training_cpu_seconds REAL, training_wall_seconds REAL, recorded_at TEXT NOT NULL, result TEXT NOT NULL,
    track TEXT NOT NULL DEFAULT 'shared'
);
"""

_PLANNED = """
CREATE TABLE IF NOT EXISTS planned (
    key TEXT PRIMARY KEY, task TEXT NOT NULL, method TEXT NOT NULL, agent TEXT NOT NULL, seed INTEGER NOT NULL,
    budget TEXT NOT NULL, track TEXT NOT NULL DEFAULT 'shared'
);
"""

_LISTED = f"SELECT rowid, key, status, {_IDENTITY} FROM cells"  # noqa: S608


class LedgerWarning(UserWarning):
    """A part of a ledger is damaged; the others can be read."""


class _Row(NamedTuple):
    """What a row says without its result."""

    number: int
    key: str
    status: str
    identity: tuple[str | int, ...]

    @classmethod
    def of(cls, number: int, key: str, status: str, *identity: str | int) -> Self:
        """That of `_LISTED`."""
        return cls(number, key, status, identity)


class Ledger:
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
        self.path = path
        self._database: sqlite3.Connection | None = None
        self._is_writing = False
        if (path.exists() and not path.is_file()) or (_has_content(path) and not is_sqlite(path)):
            raise UsageError(f"{path} is no ledger of stlbench; it is left as it is")
        if path.exists():
            self._database = self._opened(_to_read(path), self._check_to_read)
        elif not create:
            raise UsageError(f"there is no ledger at {path}; `stlbench run` writes one")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the file. All that was recorded is there already."""
        if self._database is not None:
            self._database.close()

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
            rows = [(key, *_texts(cell)) for key, cell in cells.items()]
            database.executemany("INSERT OR REPLACE INTO planned VALUES (?, ?, ?, ?, ?, ?, ?)", rows)

    def record(self, result: Result) -> None:
        """Write one result, in place of one with the same key. On return it is on disk."""
        row = _row(result)
        with self._writing() as database:
            database.execute(f"INSERT OR REPLACE INTO cells VALUES ({', '.join('?' * len(row))})", row)  # noqa: S608

    def remove(self, cell: CellId) -> list[str]:
        """Take a cell out, with all its results, older ones too, and its place in the plan; the keys it had."""
        keys = list[str]()
        with self._writing() as database:
            for table in ("cells", "planned"):
                rows = database.execute(
                    f"DELETE FROM {table} WHERE ({', '.join(IDENTITY)}) = (?, ?, ?, ?, ?, ?) RETURNING key",  # noqa: S608
                    _texts(cell),
                )
                keys += [key for (key,) in rows]
        return list(dict.fromkeys(keys))

    # ----------------------------------------------------------------------------------------------------- reading

    def finished(self, keys: Iterable[str], retry: bool = False) -> set[str]:
        """Those of the keys that have a row; with `retry` only those that did not end by an accident, and whose row is
        not damaged."""
        rows = {row.key: row for row in self._listed()}
        found = [rows[key] for key in keys if key in rows]
        if retry:
            found = [row for row in found if row.status not in ACCIDENTS and self._read(row) is not None]
        return {row.key for row in found}

    def missing(self) -> list[CellId]:
        """The cells that were planned and have no result, ordered."""
        return sorted(set(map(_cell, self._planned().values())) - {_cell(row.identity) for row in self._listed()})

    def results(self, keys: Collection[str] | None = None) -> Iterator[Result]:
        """The results with these keys, or one of every cell, ordered by task, method, agent and seed.

        A plugin that was edited has other keys. Of a cell that has several results, the one counts that was planned
        last, else the newest. A row that is damaged is passed over, with a `LedgerWarning`.
        """
        rows = self._listed()
        chosen = {row.key for row in self._present(rows)} if keys is None else frozenset(keys)
        for row in sorted(rows, key=lambda row: (row.identity[:4], row.key)):
            if row.key in chosen and (result := self._read(row)) is not None:
                yield result

    def counted(self, *, accidents: bool = True) -> dict[CellId, str]:
        """Of each cell that has a result the key of the one that counts; of those that ended by an accident too."""
        present = self._present(self._listed())
        return {_cell(row.identity): row.key for row in present if accidents or row.status not in ACCIDENTS}

    def _present(self, rows: Iterable[_Row]) -> Collection[_Row]:
        """Of each cell the row that was planned last, else the newest."""
        planned = self._planned()
        return {row.identity: row for row in sorted(rows, key=lambda row: (row.key in planned, row.number))}.values()

    def _planned(self) -> dict[str, tuple[str | int, ...]]:
        try:
            return {key: tuple(identity) for key, *identity in self._rows(f"SELECT key, {_IDENTITY} FROM planned")}  # noqa: S608
        except sqlite3.DatabaseError as error:
            warnings.warn(f"{self.path}: its plan is damaged and passed over ({error})", LedgerWarning, stacklevel=3)
            return {}

    def _listed(self) -> list[_Row]:
        """All rows, one by one where a page of the file is damaged: then those that can be read."""
        try:
            return [_Row.of(*row) for row in self._rows(_LISTED)]
        except sqlite3.DatabaseError:
            return self._salvaged()

    def _salvaged(self) -> list[_Row]:
        found, planned = list[_Row](), self._planned()
        try:
            listed = self._rows("SELECT rowid, key FROM cells")  # of an index, which is in other pages
        except sqlite3.DatabaseError as error:
            raise UsageError(f"{self.path} is damaged so far that its cells cannot be told apart: {error}") from error
        for number, key in listed:
            try:
                (row,) = self._rows(f"{_LISTED} WHERE rowid = ?", number)
                found.append(_Row.of(*row))
            except (sqlite3.DatabaseError, ValueError) as error:
                name = _cell(planned[key]).name if key in planned else f"the cell with key {key}"
                self._warn(name, error)
        return found

    def _read(self, row: _Row) -> Result | None:
        """The result of a row; None, with a warning, where it is damaged."""
        try:
            ((text,),) = self._rows("SELECT result FROM cells WHERE rowid = ? AND key = ?", row.number, row.key)
            return from_json(text)
        except (sqlite3.DatabaseError, ValueError) as error:
            self._warn(_cell(row.identity).name, error)
            return None

    def _warn(self, name: str, error: Exception) -> None:
        said = f"{self.path}: the row of {name} is damaged and passed over; `run --retry` measures it again"
        warnings.warn(f"{said} ({one_line(str(error).splitlines()[0])})", LedgerWarning, stacklevel=3)

    # ----------------------------------------------------------------------------------------------------- opening

    def _rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        """All at once: as long as a reader is at it, nobody can write."""
        return [] if self._database is None else self._database.execute(query, values).fetchall()

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        """A transaction, in a file that is made where there is none."""
        if not self._is_writing:
            self.close()
            self._database = self._opened(partial(_to_write, self.path), self._check_to_write)
            self._is_writing = True
        assert self._database is not None
        try:
            with self._database as database:
                database.execute("BEGIN IMMEDIATE")
                yield database
        except sqlite3.DatabaseError as error:
            raise UsageError(f"cannot write the ledger {self.path}: {error}{_way_out(error)}") from error

    def _opened(
        self, connect: Callable[[], sqlite3.Connection], prepared: Callable[[sqlite3.Connection], sqlite3.Connection]
    ) -> sqlite3.Connection:
        try:
            with ExitStack() as undone:
                database = connect()
                undone.callback(database.close)
                ready = prepared(database)
                undone.pop_all()
                return ready
        except (OSError, sqlite3.Error) as error:
            can = "open" if isinstance(error, OSError | sqlite3.OperationalError) else "read"
            raise UsageError(f"cannot {can} the ledger {self.path}: {error}") from error

    def _version(self, database: sqlite3.Connection) -> int:
        """0 of a file that is empty. Raises `UsageError` where it is no ledger, or one of a newer version."""
        application, version, tables = (
            int(database.execute(query).fetchone()[0])
            for query in ("PRAGMA application_id", "PRAGMA user_version", "SELECT count(*) FROM sqlite_schema")
        )
        if (application, version, tables) == (0, 0, 0):
            return 0
        if application != APPLICATION:
            raise UsageError(f"{self.path} is no ledger of stlbench")
        if version > VERSION:
            raise UsageError(f"{self.path} is a ledger of version {version}; this stlbench reads version {VERSION}")
        return version

    def _check_to_read(self, database: sqlite3.Connection) -> sqlite3.Connection:
        """The same, or a copy in memory of one of an older version."""
        if self._version(database) == VERSION:
            return database
        copy = sqlite3.connect(":memory:", isolation_level=None)
        database.backup(copy)
        database.close()
        _write_schema(copy)
        _add_tracks(copy)
        return copy

    def _check_to_write(self, database: sqlite3.Connection) -> sqlite3.Connection:
        version = self._version(database)
        # not WAL, in which what was recorded lies in another file until some time later
        database.execute("PRAGMA journal_mode = DELETE")
        if version < VERSION:
            _write_schema(database)
            _add_tracks(database)
        return database


def _to_read(path: Path) -> Callable[[], sqlite3.Connection]:
    """How to open a file to read it, also in a folder that cannot be written."""
    uri = f"{path.absolute().as_uri()}?mode=ro"

    def connect() -> sqlite3.Connection:
        database = sqlite3.connect(uri, uri=True, timeout=30, isolation_level=None)
        try:
            database.execute("SELECT count(*) FROM sqlite_schema")
        except sqlite3.OperationalError:  # in WAL mode, of before, SQLite wants to write beside it
            database.close()
            if _has_content(path.with_name(f"{path.name}-wal")):
                raise
            database = sqlite3.connect(f"{uri}&immutable=1", uri=True, isolation_level=None)
        return database

    return connect


def _to_write(path: Path) -> sqlite3.Connection:
    path.parent.mkdir(parents=True, exist_ok=True)
    return sqlite3.connect(path, timeout=30, isolation_level=None)


def _has_content(path: Path) -> bool:
    return path.is_file() and path.stat().st_size > 0


def _way_out(error: sqlite3.DatabaseError) -> str:
    damaged = getattr(error, "sqlite_errorcode", 0) in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
    return "; `stlbench results merge NEW OLD` copies what can be read into a new folder" if damaged else ""


def _cell(identity: tuple[Any, ...]) -> CellId:
    task, method, agent, seed, budget, track = identity
    return CellId(parse_choice(task), parse_choice(method), parse_choice(agent), seed, budget, track)


def _write_schema(database: sqlite3.Connection) -> None:
    """Make the tables that are not there: all in a new file, the plan in one of version 1."""
    pragmas = f"PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {VERSION};"
    database.executescript(f"BEGIN IMMEDIATE; {_CELLS} {_PLANNED} {pragmas} COMMIT;")


def _add_tracks(database: sqlite3.Connection) -> None:
    """To the tables of an older version."""
    for table in ("cells", "planned"):
        if "track" not in {row[1] for row in database.execute(f"PRAGMA table_info({table})")}:
            database.execute(f"ALTER TABLE {table} ADD COLUMN track TEXT NOT NULL DEFAULT 'shared'")


def is_sqlite(path: Path) -> bool:
    """Whether a file begins as SQLite's do; one of a byte or two looks empty to SQLite, which would write over it."""
    with path.open("rb") as file:
        return file.read(16) == b"SQLite format 3\0"


def _texts(cell: CellId) -> tuple[str, str, str, int, str, str]:
    return str(cell.task), str(cell.method), str(cell.agent), cell.seed, cell.budget, cell.track


def _row(result: Result) -> tuple[str | int | float | None, ...]:
    measured = result.measurement
    score = reported(measured.selected) if measured else None
    task, method, agent, seed, budget, track = _texts(result.id)
    return (
        *(result.key, task, method, agent, seed, budget, result.status, result.reason),
        score.mean if score else None,
        score.satisfaction if score else None,
        measured.training_cpu_seconds if measured else None,
        measured.training_wall_seconds if measured else None,
        datetime.now(UTC).isoformat(timespec="seconds"),
        to_json(result),
        track,
    )
