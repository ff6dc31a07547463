"""Ledgers of every format that git's history has: they are read, and become one of today when something is written."""

from __future__ import annotations

import errno
import json
import sqlite3

import pytest
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records import schema
from stlbench.records.ledger import Ledger
from stlbench.records.result import to_json
from stlbench.records.rows import LISTED
from stlbench.records.schema import VERSION

CELLS = """
CREATE TABLE cells (
    key TEXT PRIMARY KEY, task TEXT NOT NULL, method TEXT NOT NULL, agent TEXT NOT NULL, seed INTEGER NOT NULL,
    budget TEXT NOT NULL, status TEXT NOT NULL, reason TEXT NOT NULL, robustness_mean REAL, satisfaction REAL,
    training_cpu_seconds REAL, training_wall_seconds REAL, recorded_at TEXT NOT NULL, result TEXT NOT NULL{}
);
"""
PLANNED = """
CREATE TABLE planned (
    key TEXT PRIMARY KEY, task TEXT NOT NULL, method TEXT NOT NULL, agent TEXT NOT NULL, seed INTEGER NOT NULL,
    budget TEXT NOT NULL{}
);
"""
TRACK = ", track TEXT NOT NULL DEFAULT 'shared'"
LATER = (
    ", checksum TEXT NOT NULL DEFAULT '', files TEXT NOT NULL DEFAULT '', "
    "failures INTEGER NOT NULL DEFAULT 0, again INTEGER NOT NULL DEFAULT 0"
)
OLD = {
    1: CELLS.format(""),
    2: CELLS.format("") + PLANNED.format(""),
    3: CELLS.format(TRACK) + PLANNED.format(TRACK),
    4: CELLS.format(TRACK + LATER) + PLANNED.format(TRACK),
}
"""By version: commits a25648b, 593c7ac, 6f00691 and 5d66f47."""


def without(text, *names):
    return json.dumps({name: value for name, value in json.loads(text).items() if name not in names})


def write(path, version, journal="delete"):
    """One cell that is done, one that failed, and a plan of three where there is one."""
    entries = [result(seed=0), result(seed=1, status="killed", reason="by signal 9"), result(seed=2)]
    database = sqlite3.connect(path)
    database.execute(f"PRAGMA journal_mode = {journal}")
    database.executescript(f"{OLD[version]} PRAGMA application_id = 1398033474; PRAGMA user_version = {version};")
    for entry in entries[:2]:
        row = [entry.key, "hold-disc", "funnel", "dqn", entry.id.seed, "quick", entry.status, entry.reason]
        text = to_json(entry) if version > 2 else without(to_json(entry), "track")
        row += [0.3, 1.0, 10.0, 12.0, "2026-11-20T10:00:00+00:00", text, *(["shared"] if version > 2 else [])]
        row += ["", "", 0, 0] if version > 3 else []
        database.execute(f"INSERT INTO cells VALUES ({', '.join('?' * len(row))})", row)
    for entry in entries if version > 1 else ():
        row = [entry.key, "hold-disc", "funnel", "dqn", entry.id.seed, "quick", *(["shared"] if version > 2 else [])]
        database.execute(f"INSERT INTO planned VALUES ({', '.join('?' * len(row))})", row)
    database.commit()
    database.close()
    return entries


def columns_of(database):
    tables = ("cells", "planned")
    return {table: {row[1] for row in database.execute(f"PRAGMA table_info({table})")} for table in tables}


def plan_of_listing(database):
    ((*_, said),) = database.execute(f"EXPLAIN QUERY PLAN SELECT rowid, {LISTED} FROM cells")
    return said


@pytest.fixture
def path(tmp_path):
    return tmp_path / "ledger.sqlite"


@pytest.mark.parametrize("journal", ["delete", "wal"])
@pytest.mark.parametrize("version", OLD)
def test_an_old_ledger_is_read_as_it_is(path, version, journal):
    entries = write(path, version, journal)
    before = path.read_bytes()
    with Ledger(path, create=False) as ledger:
        assert list(ledger.results()) == entries[:2]
        assert ledger.missing() == ([entries[2].id] if version > 1 else [])
        assert ledger.finished([entry.key for entry in entries]) == {entry.key for entry in entries[:2]}
        assert ledger.finished([entries[1].key], ["killed"], 3) == set()
        assert ledger.given_up([entries[1].key], 1) == [entries[1].id]
        assert [row.files for row in ledger.recorded()] == [None, None]
    assert path.read_bytes() == before


@pytest.mark.parametrize("version", OLD)
def test_what_is_written_makes_it_one_of_today_that_has_lost_nothing(path, version):
    entries = write(path, version)
    with Ledger(path) as ledger:
        ledger.record(entries[2])
        ledger.record(entries[1])
    with Ledger(path, create=False) as ledger:
        assert list(ledger.results()) == entries
        assert ledger.given_up([entries[1].key], 2) == [entries[1].id]  # the failure of before counts
        assert [row.files for row in ledger.recorded()] == [None, {}, {}]
    database = sqlite3.connect(path)
    assert database.execute("PRAGMA user_version").fetchone() == (VERSION,)
    columns = {
        table: {row[1] for row in database.execute(f"PRAGMA table_info({table})")} for table in ("cells", "planned")
    }
    database.close()
    with Ledger(path.with_name("new.sqlite")) as ledger:
        ledger.plan({})
    new = sqlite3.connect(path.with_name("new.sqlite"))
    assert columns == columns_of(new)
    assert plan_of_listing(new) == plan_of_listing(sqlite3.connect(path)) == "SCAN cells USING COVERING INDEX listed"
    new.close()


def test_a_migration_that_fails_has_changed_nothing(path, monkeypatch):
    entries = write(path, 1)
    with Ledger(path) as ledger:
        monkeypatch.setitem(schema._ADDED, "planned", {"track": "TEXT NOT NULL DEFAULT 'shared'", "no good": "("})
        with pytest.raises(UsageError, match="cannot open the ledger"):
            ledger.record(entries[2])
    monkeypatch.undo()
    assert sqlite3.connect(path).execute("PRAGMA user_version").fetchone() == (1,)
    with Ledger(path) as ledger:
        assert list(ledger.results()) == entries[:2]


def test_a_folder_of_a_full_disk_is_a_usage_error(path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pathlib.Path.mkdir", full)
    with Ledger(path) as ledger, pytest.raises(UsageError, match="No space left on device"):
        ledger.plan({})
