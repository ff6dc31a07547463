"""The tables of a ledger, and how its file is opened: to read without a right to write, to write in one file."""

import shlex
import sqlite3
from contextlib import ExitStack, closing, suppress
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from stlbench.errors import UsageError, one_line, unwritable
from stlbench.records.identity import IDENTITY
from stlbench.records.result import SCHEMA
from stlbench.records.result_files import LINES, PACKED, inside, is_there

LISTED = f"key, status, failures, again, {', '.join(IDENTITY)}"  # the columns of a `Row`
COLUMNS = f"key, {', '.join(IDENTITY)}"  # those of `planned` and `recorded`
OLDEST, VERSION = 5, 6  # of the tables below, in `PRAGMA user_version`. One of another version is refused.
LONGEST = 2**26  # bytes that a value in a ledger may have. A result with 10,000 starts has about 1 MB.
_OPENING, _READING, _LOOK = 10**6, 10**8, 10**5
"""Steps of SQLite's machine: that reading the schema may take, that all long queries may take beside one for each byte
of the file, and after how many they are counted. To read a ledger of 100,000 cells, 1 GB, takes 10 million."""
_FILES = "", "-journal", "-wal", "-shm"  # how the names end of what SQLite opens beside a ledger
_DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB)
_COUNT_TABLES = "SELECT count(*) FROM sqlite_schema"  # the cheapest query that makes SQLite look at a file
APPLICATION = int.from_bytes(b"STLB", "big")  # in `PRAGMA application_id`: tells a ledger from any other SQLite file
_IDENTITY = """key TEXT PRIMARY KEY, task TEXT NOT NULL, method TEXT NOT NULL, agent TEXT NOT NULL,
    seed INTEGER NOT NULL, budget TEXT NOT NULL, track TEXT NOT NULL"""
_REALS = tuple(name for name, datum in SCHEMA.items() if datum.ledger)
_TABLES = (
    f"""CREATE TABLE IF NOT EXISTS cells (
    {_IDENTITY}, status TEXT NOT NULL, reason TEXT NOT NULL, {" REAL, ".join(_REALS)} REAL,
    recorded_at TEXT NOT NULL, result TEXT NOT NULL,
    checksum TEXT NOT NULL, files TEXT NOT NULL, failures INTEGER NOT NULL, again INTEGER NOT NULL
    )""",
    f"CREATE TABLE IF NOT EXISTS planned ({_IDENTITY})",
    f"CREATE TABLE IF NOT EXISTS recorded ({_IDENTITY})",
    f"CREATE INDEX IF NOT EXISTS listed ON cells ({LISTED})",
)
"""`checksum` is of the text `result`, `files` has those of the cell's files as JSON, `failures` counts how often in a
row the cell has failed, and `again` says whether the next run measures it, though it has a result. The index
finds missing cells without the pages of the results: for 100,000 cells 10 MB in place of a GB.

`recorded` lists the rows of `cells` once more: it changes in the same transactions, so one that was deleted by another
program is noticed. Version 5 did not have it."""


def is_sqlite(path: Path) -> bool:
    """Whether a file begins as SQLite's do. SQLite takes a file of a byte or two for empty, and would overwrite it."""
    with path.open("rb") as file:
        return file.read(16) == b"SQLite format 3\0"


def opened(path: Path, *, to_write: bool = False) -> sqlite3.Connection:
    """The file. To read it, its folder need not be writable; to write it, it is made if it is missing, with its folder.

    Raises `UsageError` if it is no ledger of this version.
    """
    try:
        with ExitStack() as undone:
            for end in _FILES:
                inside(path.with_name(path.name + end), path.parent, "write" if to_write else "read")
            if to_write:
                path.parent.mkdir(parents=True, exist_ok=True)
            database = _guarded(f"{path.absolute().as_uri()}?mode=rwc") if to_write else _to_read(path)
            undone.callback(database.close)
            version = _check(path, database)
            if to_write:
                database.execute("PRAGMA journal_mode = DELETE")  # in WAL mode results would be in another file
            if version is None:
                if not to_write:  # an empty file cannot be given tables here
                    database = sqlite3.connect(":memory:", isolation_level=None)
                    undone.callback(database.close)
                _make(database)
            elif to_write:
                _renew(database, version)
            undone.pop_all()
            return database
    except (OSError, sqlite3.Error) as error:
        can = "open" if isinstance(error, OSError | sqlite3.OperationalError) else "read"
        raise unusable(can, path, error) from error


def unusable(can: str, path: Path, error: OSError | sqlite3.Error) -> UsageError:
    """The error where a ledger cannot be read or written; for a damaged one it says the ways out."""
    failure = unwritable(f"cannot {can} the ledger {path}", error)
    return UsageError(f"{failure}; {way_out(path)}") if is_damaged(error) else failure


def is_damaged(error: Exception) -> bool:
    """Whether an error says that a file is damaged. Those that Python or stlbench find in it have no code of SQLite."""
    is_of_file = isinstance(error, sqlite3.DatabaseError)
    return is_of_file and getattr(error, "sqlite_errorcode", sqlite3.SQLITE_CORRUPT) & 0xFF in _DAMAGED


def way_out(path: Path) -> str:
    """How to go on where SQLite cannot read a ledger."""
    old, new = (shlex.quote(str(path.with_name(name))) for name in (path.name, f"new-{path.name}"))
    there = [name for name in (LINES, PACKED) if is_there(path.with_name(name), path.parent)]
    ways = [f"take the file away, and the results are read from {there[0]} beside it"] if there else []
    ways.append(f"SQLite's own tool writes anew what it can read: `sqlite3 {old} .recover | sqlite3 {new}`")
    return "; or ".join(ways)


def _to_read(path: Path) -> sqlite3.Connection:
    database = _guarded(f"{path.absolute().as_uri()}?mode=ro")
    try:
        database.execute(_COUNT_TABLES)
    except sqlite3.OperationalError as error:
        database.close()
        if error.sqlite_errorcode != sqlite3.SQLITE_READONLY_ROLLBACK:
            raise
        return _rolled_back(path)
    return database


def _rolled_back(path: Path) -> sqlite3.Connection:
    """The file of a run that was killed within a transaction, without that transaction.

    The journal undoes it. In a folder that cannot be written, this happens in a copy.
    """
    database = _guarded(f"{path.absolute().as_uri()}?mode=rw")
    try:
        database.execute(_COUNT_TABLES)
    except sqlite3.OperationalError:
        database.close()
        database = sqlite3.connect(":memory:", isolation_level=None)
        with TemporaryDirectory() as folder:
            for file in (path, path.with_name(f"{path.name}-journal")):
                Path(folder, file.name).write_bytes(file.read_bytes())
            with closing(sqlite3.connect(Path(folder, path.name))) as whole:
                whole.backup(database)
    return database


def _make(database: sqlite3.Connection) -> None:
    """Make the tables in an empty file: all of them or nothing."""
    with database:
        database.execute("BEGIN IMMEDIATE")
        for statement in _TABLES:
            database.execute(statement)
        database.execute(f"PRAGMA application_id = {APPLICATION}")
        database.execute(f"PRAGMA user_version = {VERSION}")


class _Connection(sqlite3.Connection):
    """SQLite's errors quote names of the file. If these are no UTF-8, Python raises another error."""

    def execute(self, *query: Any) -> sqlite3.Cursor:
        try:
            return super().execute(*query)
        except UnicodeDecodeError as error:
            raise sqlite3.DatabaseError(f"a name in it is no UTF-8 ({one_line(error)})") from error


def _renew(database: sqlite3.Connection, version: int) -> None:
    """Give a ledger the columns of `SCHEMA` that it lacks, and one of the version before the list of its rows, as far
    as the index says them."""
    known = {row[1] for row in database.execute("PRAGMA table_info(cells)")}
    lacking = [name for name in _REALS if name not in known]
    if version == VERSION and not lacking:
        return
    with database:
        database.execute("BEGIN IMMEDIATE")
        for name in lacking:
            database.execute(f"ALTER TABLE cells ADD COLUMN {name} REAL")
        for statement in _TABLES:
            database.execute(statement)
        with suppress(sqlite3.DatabaseError):
            database.execute(f"INSERT OR IGNORE INTO recorded ({COLUMNS}) SELECT {COLUMNS} FROM cells")  # noqa: S608
        database.execute(f"PRAGMA user_version = {VERSION}")


def _guarded(uri: str) -> sqlite3.Connection:
    """A connection on which a file from a stranger can cost only so much memory and time.

    SQLite then calls a longer value "too big", and a query that takes more steps "interrupted".
    """
    database = sqlite3.connect(uri, uri=True, timeout=30, isolation_level=None, factory=_Connection)
    database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST)
    _allow(database, _OPENING)
    # SQLite takes any bytes for a text. Those that are no UTF-8 become a text that no row may have.
    database.text_factory = lambda data: data.decode(errors="backslashreplace")
    database.execute("PRAGMA trusted_schema = OFF")
    return database


def _allow(database: sqlite3.Connection, steps: int) -> None:
    left = iter(range(steps // _LOOK))
    database.set_progress_handler(lambda: next(left, None) is None, _LOOK)


def _check(path: Path, database: sqlite3.Connection) -> int | None:
    """Its version; None if the file is empty. Raises `UsageError` where it is neither that nor a ledger."""
    application, version, tables = (
        int(database.execute(query).fetchone()[0])
        for query in ("PRAGMA application_id", "PRAGMA user_version", _COUNT_TABLES)
    )
    if (application, version, tables) == (0, 0, 0):
        _allow(database, 2**62)  # it is empty, so all that it will have is ours
        return None
    if application != APPLICATION:
        raise UsageError(f"{path} is no ledger of stlbench")
    if not OLDEST <= version <= VERSION:
        raise UsageError(f"{path} is a ledger of version {version}; this stlbench reads {OLDEST} to {VERSION}")
    if (strange := _strange(database)) is not None:
        raise UsageError(f"the ledger {path} has {strange}, which stlbench does not write; it is not read")
    _allow(database, _READING + path.stat().st_size)
    return version


def _strange(database: sqlite3.Connection) -> str | None:
    """A part of the schema that no ledger has, such as a view or a trigger, which are code; None if there is none."""
    tables, indices = _expected()
    for kind, name, sql in database.execute("SELECT type, name, sql FROM sqlite_schema"):
        if kind == "index" and (name, sql) in indices:
            continue
        if kind != "table" or name not in tables or not str(sql).startswith("CREATE TABLE "):
            return f"the {one_line(kind)} '{one_line(name)}'"
        for _, column, *_, hidden in database.execute(f"PRAGMA table_xinfo({name})"):
            if hidden or column not in tables[name]:
                return f"the column '{one_line(column)}' in the table '{name}'"
    return None


@cache
def _expected() -> tuple[dict[str, set[str]], set[tuple[str, str | None]]]:
    with closing(sqlite3.connect(":memory:", isolation_level=None)) as empty:
        _make(empty)
        named = empty.execute("SELECT type, name, sql FROM sqlite_schema").fetchall()
        columns = {
            name: {str(row[1]) for row in empty.execute(f"PRAGMA table_info({name})")}
            for kind, name, _ in named
            if kind == "table"
        }
    return columns, {(name, sql) for kind, name, sql in named if kind == "index"}
