"""The ledger: one SQLite file, one row and one transaction per cell. Only the parent process writes.

It is read row by row: a damaged part is named in a warning, and skipped.
"""

import sqlite3
import warnings
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import prod
from operator import itemgetter
from pathlib import Path
from typing import Any, Self

from stlbench.errors import UsageError, one_line
from stlbench.records import lines
from stlbench.records.identity import IDENTITY, MOST, OUTSIDE, CellId, Name, valid
from stlbench.records.result import ACCIDENTS, Result, Status, plain
from stlbench.records.rows import OTHER, Inspected, LedgerWarning, Row, agree, cell_of, result_of, texts, values
from stlbench.records.schema import COLUMNS, LISTED, VERSION, is_damaged, is_sqlite, opened, unusable

LEDGER = "ledger.sqlite"  # its name in a folder of results
_IDENTITY = ", ".join(IDENTITY)


class Ledger:
    """The rows and the plan of a folder of results, as a context manager.

    The column `result` has JSON. The other columns are for SQL: `sqlite3 ledger.sqlite "select * from cells"`. Reading
    needs no right to write. A missing file has no rows, if `create` allows that; writing makes it, and the folders
    above it. Raises `UsageError` if the file is something else, or was written by another version, or if SQLite finds
    it damaged.
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
        self._is_writing = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.close()

    def close(self) -> None:
        if self._database is not None:
            self._database.close()

    def planned(self) -> dict[str, CellId]:
        return self._cells("planned", "the plan")

    def recorded(self) -> dict[str, CellId]:
        """The cells of all rows that were recorded and not removed; none of a ledger of the version before."""
        return self._cells("recorded", "the list of its rows") if self._lists_rows else {}

    @property
    def _lists_rows(self) -> bool:
        tables = "SELECT count(*) FROM sqlite_schema WHERE name = 'recorded'"
        return self._database is not None and bool(_first(self._database.execute(tables)))

    def _cells(self, table: str, what: str) -> dict[str, CellId]:
        cells = dict[str, CellId]()
        for _, key, *identity in self._rows(table, COLUMNS):
            try:
                cells[valid(Name, key)] = cell_of(*identity)
            except ValueError as error:
                self._warn(f"a part of {what}", str(error))
        return cells

    def _rows(self, table: str, columns: str, *, from_index: bool = False, most: int = -1) -> list[tuple[Any, ...]]:
        """Number and columns of a table's rows, in the order of their numbers; no more than `most` of them.

        `from_index` reads an index that has all these columns, which is far shorter than the table. It does not see
        damage of the table alone.
        """
        if self._database is None:
            return []
        query = f"SELECT rowid, {columns} FROM {table}{'' if from_index else ' NOT INDEXED'} LIMIT {most}"  # noqa: S608
        try:
            size = prod(_first(self._database.execute(f"PRAGMA {name}")) for name in ("page_count", "page_size"))
            return sorted(_within(self._database.execute(query), size), key=itemgetter(0))
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

    def inspected(self) -> Iterator[Inspected]:
        """Every row, whatever it holds, one at a time."""
        for columns in self._rows("cells", LISTED):
            yield self._inspected(*columns)

    def _inspected(self, number: int, key: str, *columns: Any) -> Inspected:
        again = bool(columns[2])
        try:
            row = Row.of(number, key, *columns)
        except ValueError:
            row = None
        content = self._content(number, key, "*")
        if isinstance(content, str):
            return Inspected(key, row.cell if row else None, {}, one_line(content), again)
        result, files, said = content
        if row is None or not agree(said, result):
            return Inspected(key, result.id, {}, OTHER, again, result.key)
        return Inspected(key, result.id, files, result, again)

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
        self._warn(f"the row of {row.cell.name}", content if isinstance(content, str) else OTHER)
        return None

    def _content(
        self, number: int, key: str, columns: str = "result, checksum, files"
    ) -> tuple[Result, Mapping[str, str], Mapping[str, Any]] | str:
        """A row's result, the checksums of its files, and the columns that were asked for; or what is wrong with it."""
        assert self._database is not None
        query = f"SELECT {columns} FROM cells WHERE rowid = ? AND key = ?"  # noqa: S608
        try:
            cursor = self._database.execute(query, (number, key))
            found = cursor.fetchone()
        except sqlite3.DatabaseError as error:
            if is_damaged(error):
                raise unusable("read", self.path, error) from error
            return str(error)
        if found is None:
            return "it is not where the index has it"
        said = {name: value for (name, *_), value in zip(cursor.description, found, strict=True)}
        try:
            result, checksums = result_of(said["result"], said["checksum"]), plain(said["files"])
        except ValueError as error:
            return str(error).splitlines()[0]
        if not isinstance(checksums, dict):
            return f"checksums of its files are an object, got {said['files']!r:.80}"
        return result, checksums, said

    def _warn(self, what: str, problem: str) -> None:
        way = f"`stlbench verify {self.path.parent} --repair` has it measured again"
        cause = one_line(problem.splitlines()[0])
        text = f"{self.path}: {one_line(what)} is damaged and passed over; {way} ({cause})"
        warnings.warn(text, LedgerWarning, stacklevel=3)

    def plan(self, cells: Mapping[str, CellId]) -> None:
        """Write the cells of a study, by key, in place of earlier plans for the same settings."""
        settings = {
            (str(cell.task), str(cell.method), str(cell.agent), cell.budget, cell.track) for cell in cells.values()
        }
        with self._writing() as database:
            database.executemany(
                "DELETE FROM planned WHERE (task, method, agent, budget, track) = (?, ?, ?, ?, ?)", sorted(settings)
            )
            _add_plan(database, cells)

    def plan_also(self, cells: Mapping[str, CellId]) -> None:
        """Write further cells of a study, by key."""
        with self._writing() as database:
            _add_plan(database, cells)

    def record(self, result: Result, *, again: bool = False) -> None:
        """Write one result, in place of one with the same key, with checksums of its files. It is on disk on return.

        `again` has the next run measure the cell, as `mark` does.
        Before, it is a line of `cells.jsonl`: whenever this is killed, what was recorded is in both.
        """
        lines.append(self.path.parent, [result])
        with self._writing() as database:
            before = database.execute("SELECT failures FROM cells WHERE key = ?", (result.key,)).fetchone()
            known = before[0] if before and isinstance(before[0], int) and 0 <= before[0] < MOST else 0
            failures = known + 1 if result.status in ACCIDENTS else 0
            _insert(database, values(result, self.path.parent, failures, again=again))

    def replace(self, result: Result, *, again: bool = False) -> list[str]:
        """Write one result in place of all others of its cell, and of other keys in the plan; the keys these had.

        It is one transaction: whenever this is killed, the old results or the new one are there.
        """
        lines.append(self.path.parent, [result])
        with self._writing() as database:
            planned = database.execute("SELECT 1 FROM planned WHERE key = ?", (result.key,)).fetchone()
            keys = _remove(database, result.id)
            _add_plan(database, {result.key: result.id} if planned else {})
            _insert(database, values(result, self.path.parent, int(result.status in ACCIDENTS), again=again))
        return keys

    @property
    def is_empty(self) -> bool:
        """Whether it has neither a plan nor a row, nor lists one that is gone."""
        tables = ("cells", "planned", *(["recorded"] if self._lists_rows else []))
        return not any(self._rows(table, "key", most=1) for table in tables)

    def fill(self, cells: Mapping[str, CellId], results: Iterable[Result]) -> None:
        """Write the cells of a study, by key, and results, all or none of them."""
        with self._writing() as database:
            _add_plan(database, cells)
            for result in results:
                _insert(database, values(result, self.path.parent, int(result.status in ACCIDENTS)))

    def mark(self, key: str, own: str) -> None:
        """Have the next run measure the cell with this key. Its result counts until then.

        `own` is the key in its result. A row with another key gets it, unless a row has it already. The cell of a row
        that is gone is planned.
        """
        with self._writing() as database:
            database.execute("UPDATE OR IGNORE cells SET again = 1, key = ? WHERE key = ?", (own, key))
            if own != key:
                database.execute("DELETE FROM cells WHERE key = ?", (key,))
            gone = "key = ? AND NOT EXISTS (SELECT 1 FROM cells WHERE cells.key = recorded.key)"
            plan = f"INSERT OR IGNORE INTO planned ({COLUMNS}) SELECT {COLUMNS} FROM recorded WHERE {gone}"  # noqa: S608
            database.execute(f"{plan} AND track != '{OUTSIDE}'", (key,))
            database.execute(f"DELETE FROM recorded WHERE {gone}", (key,))  # noqa: S608

    def remove(self, cell: CellId) -> list[str]:
        """Remove a cell, with all its results and its place in the plan; the keys it had."""
        with self._writing() as database:
            keys = _remove(database, cell)
        lines.append(self.path.parent, removed=[cell] if keys else ())
        return keys

    def finished(self, keys: Iterable[str], retry: Collection[Status] = (), attempts: int | None = None) -> set[str]:
        """The keys of which the next run measures no cell.

        A run measures again cells that ended as `retry` says, and then also cells whose row is damaged. A cell that
        failed `attempts` times in a row is given up, and finished.
        """
        rows = {row.key: row for row in self.listed()}
        rows_of_keys = [rows[key] for key in keys if key in rows and not rows[key].again]
        if retry:
            again = {row.key for row in rows_of_keys if row.status in retry and not _is_given_up(row, attempts)}
            rows_of_keys = [row for row in rows_of_keys if row.key not in again and self.read(row) is not None]
        return {row.key for row in rows_of_keys}

    def given_up(self, keys: Collection[str], attempts: int) -> list[CellId]:
        """The cells with these keys that failed so often in a row."""
        wanted = frozenset(keys)
        return sorted(row.cell for row in self.listed() if row.key in wanted and _is_given_up(row, attempts))

    def missing(self) -> list[CellId]:
        """The cells that were planned and have no result, ordered."""
        return sorted(set(self.planned().values()) - {row.cell for row in self.listed()})

    def results(self, keys: Collection[str] | None = None) -> Iterator[Result]:
        """The results with these keys, or one of every cell, ordered by task, method, agent and seed.

        An edited plugin has other keys. If a cell has several results, the one that was planned last counts, else
        the newest. A damaged row is skipped, with a `LedgerWarning`.
        """
        rows = self.listed()
        chosen = {row.key for row in self._present(rows)} if keys is None else frozenset(keys)
        for row in sorted(rows, key=lambda row: (texts(row.cell)[:4], row.key)):
            if row.key in chosen and (result := self.read(row)) is not None:
                yield result

    def results_of(self, cells: Iterable[CellId]) -> Iterator[Result]:
        """The result of each of these cells that counts, as `results` orders them."""
        counted = self.counted()
        return self.results({counted[cell] for cell in cells if cell in counted})

    def present(self) -> dict[CellId, Row]:
        """For each cell with a result, the row of the one that counts, for `read`."""
        return {row.cell: row for row in self._present(self.listed())}

    def counted(self, *, accidents: bool = True) -> dict[CellId, str]:
        """For each cell with a result, the key of the one that counts; `accidents` may leave out accidents."""
        present = self.present().items()
        return {cell: row.key for cell, row in present if accidents or row.status not in ACCIDENTS}

    def _present(self, rows: Iterable[Row]) -> Collection[Row]:
        """For each cell the row that was planned last, else the newest."""
        planned = self.planned()
        return {row.cell: row for row in sorted(rows, key=lambda row: (row.key in planned, row.number))}.values()

    @contextmanager
    def _writing(self) -> Iterator[sqlite3.Connection]:
        if not self._is_writing:
            self.close()
            self._database = opened(self.path, to_write=True)
            self._is_writing = True
        assert self._database is not None
        try:
            with self._database as database:
                database.execute("BEGIN IMMEDIATE")
                yield database
        except sqlite3.DatabaseError as error:
            raise unusable("write", self.path, error) from error


def _remove(database: sqlite3.Connection, cell: CellId) -> list[str]:
    """Remove all rows of a cell; the keys they had, but those that are no text, as a stranger may have written them."""
    keys = list[str]()
    for table in ("cells", "planned", "recorded"):
        query = f"DELETE FROM {table} WHERE ({_IDENTITY}) = (?, ?, ?, ?, ?, ?) RETURNING key"  # noqa: S608
        keys += [key for (key,) in database.execute(query, texts(cell)) if isinstance(key, str)]
    return list(dict.fromkeys(keys))


def _add_plan(database: sqlite3.Connection, cells: Mapping[str, CellId]) -> None:
    _list(database, "planned", [(key, *texts(cell)) for key, cell in cells.items()])


def _list(database: sqlite3.Connection, table: str, rows: Iterable[Sequence[Any]]) -> None:
    """Write rows of `COLUMNS`."""
    marks = ", ".join("?" * (1 + len(IDENTITY)))
    database.executemany(f"INSERT OR REPLACE INTO {table} ({COLUMNS}) VALUES ({marks})", rows)  # noqa: S608


def _insert(database: sqlite3.Connection, columns: Mapping[str, Any]) -> None:
    names, marks = ", ".join(columns), ", ".join("?" * len(columns))
    database.execute(f"INSERT OR REPLACE INTO cells ({names}) VALUES ({marks})", tuple(columns.values()))  # noqa: S608
    _list(database, "recorded", [[columns[name] for name in ("key", *IDENTITY)]])


def _is_given_up(row: Row, attempts: int | None) -> bool:
    return attempts is not None and row.failures >= attempts


def _within(rows: Iterable[tuple[Any, ...]], room: int) -> Iterator[tuple[Any, ...]]:
    """Raises `DatabaseError` after so many bytes: damaged pages can repeat a row for ever."""
    for row in rows:
        room -= sum(len(value) if isinstance(value, str | bytes) else 1 for value in row)
        if room < 0:
            raise sqlite3.DatabaseError("its rows say more than the file holds")
        yield row


def _first(rows: Iterable[tuple[Any, ...]]) -> int:
    return next((int(row[0] or 0) for row in rows), 0)
