"""The ledger: one SQLite file, one row and one transaction per cell. Only the parent process writes."""

from __future__ import annotations

import sqlite3
from collections.abc import Collection, Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Self

from stlbench.errors import UsageError
from stlbench.result import ACCIDENTS, MAIN, Result, from_json, to_json

__all__ = ["FILE", "VERSION", "Ledger", "is_sqlite"]

FILE = "ledger.sqlite"
"""Its name in a folder of results."""

VERSION = 1
"""Of the tables below, in `PRAGMA user_version`."""

APPLICATION = int.from_bytes(b"STLB", "big")
"""In `PRAGMA application_id`: tells a ledger from any other SQLite file."""

_SCHEMA = f"""
BEGIN IMMEDIATE;
CREATE TABLE IF NOT EXISTS cells (
    key TEXT PRIMARY KEY, task TEXT NOT NULL, method TEXT NOT NULL, agent TEXT NOT NULL, seed INTEGER NOT NULL,
    budget TEXT NOT NULL, status TEXT NOT NULL, reason TEXT NOT NULL, robustness_mean REAL, satisfaction REAL,
    training_cpu_seconds REAL, training_wall_seconds REAL, recorded_at TEXT NOT NULL, result TEXT NOT NULL
);
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {VERSION};
COMMIT;
"""


class Ledger:
    """A file of results, as a context manager.

    Columns beside the JSON of `result` are there for SQL: `sqlite3 ledger.sqlite "select * from cells"`.

    Args:
        path: the file; folders above it are made.
        create: make the file where there is none. A reader says False and gets a `UsageError` instead.

    Raises:
        UsageError: the file is something else, or was written by a newer version.
    """

    def __init__(self, path: Path, *, create: bool = True) -> None:
        self.path = path
        if not create and not path.is_file():
            raise UsageError(f"there is no ledger at {path}; `stlbench run` writes one")
        if path.is_file() and path.stat().st_size and not is_sqlite(path):
            raise UsageError(f"{path} is no ledger of stlbench; it is left as it is")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._database = sqlite3.connect(path, timeout=30, isolation_level=None)
        except (OSError, sqlite3.Error) as error:
            raise UsageError(f"cannot open the ledger {path}: {error}") from error
        try:
            self._prepare()
        except BaseException:
            self._database.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        """Close the file. All that was recorded is there already."""
        self._database.close()

    def record(self, result: Result) -> None:
        """Write one result, in place of one with the same key. On return it is on disk."""
        row = _row(result)
        self._database.execute(f"INSERT OR REPLACE INTO cells VALUES ({', '.join('?' * len(row))})", row)  # noqa: S608

    def finished(self, keys: Iterable[str], retry: bool = False) -> set[str]:
        """Those of the keys that have a row; with `retry` only those that did not end by an accident."""
        statuses = dict(self._database.execute("SELECT key, status FROM cells"))
        return {key for key in keys if key in statuses and not (retry and statuses[key] in ACCIDENTS)}

    def results(self, keys: Collection[str] | None = None) -> Iterator[Result]:
        """The results with these keys, or of every cell the newest, ordered by task, method, agent and seed.

        A plugin that was edited has other keys, and what was recorded before is no result of another seed.
        """
        wanted = self._newest() if keys is None else frozenset(keys)
        for key, text in self._database.execute(
            "SELECT key, result FROM cells ORDER BY task, method, agent, seed, key"
        ):
            if key in wanted:
                yield from_json(text)

    def _newest(self) -> frozenset[str]:
        """The key of each cell's newest row; SQLite takes `key` from the row of the maximum."""
        rows = self._database.execute("SELECT key, max(rowid) FROM cells GROUP BY task, method, agent, seed, budget")
        return frozenset(key for key, _ in rows)

    def _prepare(self) -> None:
        try:
            application, version, tables = (
                self._database.execute(query).fetchone()[0]
                for query in ("PRAGMA application_id", "PRAGMA user_version", "SELECT count(*) FROM sqlite_schema")
            )
            if (application, version, tables) == (0, 0, 0):
                self._create()
            elif application != APPLICATION:
                raise UsageError(f"{self.path} is no ledger of stlbench")
            elif version > VERSION:
                raise UsageError(f"{self.path} is a ledger of version {version}; this stlbench reads version {VERSION}")
        except sqlite3.DatabaseError as error:
            raise UsageError(f"cannot read the ledger {self.path}: {error}") from error

    def _create(self) -> None:
        self._database.execute("PRAGMA journal_mode = WAL")
        self._database.executescript(_SCHEMA)


def is_sqlite(path: Path) -> bool:
    """Whether a file begins as SQLite's do; one of a byte or two looks empty to SQLite, which would write over it."""
    with path.open("rb") as file:
        return file.read(16) == b"SQLite format 3\0"


def _row(result: Result) -> tuple[str | int | float | None, ...]:
    cell, measured = result.id, result.measurement
    score = measured.selected[MAIN] if measured else None
    return (
        *(result.key, str(cell.task), str(cell.method), str(cell.agent), cell.seed, cell.budget),
        *(result.status, result.reason),
        score.mean if score else None,
        score.satisfaction if score else None,
        measured.training_cpu_seconds if measured else None,
        measured.training_wall_seconds if measured else None,
        datetime.now(UTC).isoformat(timespec="seconds"),
        to_json(result),
    )
