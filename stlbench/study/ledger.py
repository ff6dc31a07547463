"""The ledger: one SQLite file, one row and one transaction per cell. Only the parent process writes."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from stlbench.errors import UsageError
from stlbench.registry.choices import parse_choice
from stlbench.result import ACCIDENTS, IDENTITY, CellId, Result, from_json, reported, to_json

__all__ = ["FILE", "VERSION", "Ledger", "is_sqlite"]

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

_PRESENT = """
SELECT cells.key, max((planned.key IS NOT NULL) * (1 << 62) + cells.rowid) FROM cells LEFT JOIN planned USING (key)
GROUP BY cells.task, cells.method, cells.agent, cells.seed, cells.budget, cells.track
"""
"""Of each cell the result that was planned last, else the newest; SQLite takes `key` from the row of the maximum."""

_MISSING = f"""
SELECT {_IDENTITY} FROM planned EXCEPT SELECT {_IDENTITY} FROM cells
ORDER BY {_IDENTITY}
"""  # noqa: S608


class Ledger:
    """A file of results, as a context manager.

    Columns beside the JSON of `result` are there for SQL: `sqlite3 ledger.sqlite "select * from cells"`.

    Args:
        path: the file. Where there is none, it is made, with the folders above it, when something is first written.
        create: whether that is so. A reader says False and gets a `UsageError` instead.

    Raises:
        UsageError: the file is something else, or was written by a newer version.
    """

    def __init__(self, path: Path, *, create: bool = True) -> None:
        self.path = path
        self._database: sqlite3.Connection | None = None
        if path.is_file() and path.stat().st_size and not is_sqlite(path):
            raise UsageError(f"{path} is no ledger of stlbench; it is left as it is")
        if path.exists():
            self._open()
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
        database = self._open()
        with database:
            database.execute("BEGIN IMMEDIATE")
            database.executemany(
                "DELETE FROM planned WHERE (task, method, agent, budget, track) = (?, ?, ?, ?, ?)", sorted(settings)
            )
            rows = [(key, *_texts(cell)) for key, cell in cells.items()]
            database.executemany("INSERT OR REPLACE INTO planned VALUES (?, ?, ?, ?, ?, ?, ?)", rows)

    def record(self, result: Result) -> None:
        """Write one result, in place of one with the same key. On return it is on disk."""
        row = _row(result)
        self._open().execute(f"INSERT OR REPLACE INTO cells VALUES ({', '.join('?' * len(row))})", row)  # noqa: S608

    def remove(self, cell: CellId) -> list[str]:
        """Take a cell out, with all its results, older ones too, and its place in the plan; the keys it had."""
        database, keys = self._open(), list[str]()
        with database:
            database.execute("BEGIN IMMEDIATE")
            for table in ("cells", "planned"):
                rows = database.execute(
                    f"DELETE FROM {table} WHERE ({', '.join(IDENTITY)}) = (?, ?, ?, ?, ?, ?) RETURNING key",  # noqa: S608
                    _texts(cell),
                )
                keys += [key for (key,) in rows]
        return list(dict.fromkeys(keys))

    # ----------------------------------------------------------------------------------------------------- reading

    def finished(self, keys: Iterable[str], retry: bool = False) -> set[str]:
        """Those of the keys that have a row; with `retry` only those that did not end by an accident."""
        statuses = {key: status for key, status in self._rows("SELECT key, status FROM cells")}
        return {key for key in keys if key in statuses and not (retry and statuses[key] in ACCIDENTS)}

    def missing(self) -> list[CellId]:
        """The cells that were planned and have no result, ordered."""
        rows = self._rows(_MISSING)
        return [
            CellId(parse_choice(task), parse_choice(method), parse_choice(agent), seed, budget, track)
            for task, method, agent, seed, budget, track in rows
        ]

    def results(self, keys: Collection[str] | None = None) -> Iterator[Result]:
        """The results with these keys, or one of every cell, ordered by task, method, agent and seed.

        A plugin that was edited has other keys. Of a cell that has several results, the one counts that was planned
        last, else the newest.
        """
        chosen = {key for key, _ in self._rows(_PRESENT)} if keys is None else frozenset(keys)
        for key, text in self._rows("SELECT key, result FROM cells ORDER BY task, method, agent, seed, key"):
            if key in chosen:
                yield from_json(text)

    # ----------------------------------------------------------------------------------------------------- opening

    def _rows(self, query: str) -> Iterable[tuple[Any, ...]]:
        return () if self._database is None else self._database.execute(query)

    def _open(self) -> sqlite3.Connection:
        """The file, made where there is none."""
        if self._database is None:
            try:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                database = sqlite3.connect(self.path, timeout=30, isolation_level=None)
            except (OSError, sqlite3.Error) as error:
                raise UsageError(f"cannot open the ledger {self.path}: {error}") from error
            try:
                self._prepare(database)
            except BaseException:
                database.close()
                raise
            self._database = database
        return self._database

    def _prepare(self, database: sqlite3.Connection) -> None:
        try:
            application, version, tables = (
                database.execute(query).fetchone()[0]
                for query in ("PRAGMA application_id", "PRAGMA user_version", "SELECT count(*) FROM sqlite_schema")
            )
            if (application, version, tables) == (0, 0, 0):
                database.execute("PRAGMA journal_mode = WAL")
                _write_schema(database)
            elif application != APPLICATION:
                raise UsageError(f"{self.path} is no ledger of stlbench")
            elif version > VERSION:
                raise UsageError(f"{self.path} is a ledger of version {version}; this stlbench reads version {VERSION}")
            elif version < VERSION:
                _write_schema(database)
                _add_tracks(database)
        except sqlite3.DatabaseError as error:
            raise UsageError(f"cannot read the ledger {self.path}: {error}") from error


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
