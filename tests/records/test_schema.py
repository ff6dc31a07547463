"""The file of a ledger: its tables, and files that are refused."""

from __future__ import annotations

import errno
import sqlite3

import pytest
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records.ledger import Ledger
from stlbench.records.schema import LISTED, VERSION


@pytest.fixture
def path(tmp_path):
    return tmp_path / "ledger.sqlite"


@pytest.mark.parametrize("version", [VERSION - 1, VERSION + 1])
def test_a_ledger_of_another_version_is_refused_in_a_line_and_left_as_it_is(path, version):
    with Ledger(path) as ledger:
        ledger.record(result())
    with sqlite3.connect(path) as database:
        database.execute(f"PRAGMA user_version = {version}")
    before = path.read_bytes()
    with pytest.raises(UsageError, match=f"is a ledger of version {version}; this stlbench reads version {VERSION}"):
        Ledger(path, create=False)
    assert path.read_bytes() == before


def test_what_is_missing_is_found_in_the_index_alone(path):
    with Ledger(path) as ledger:
        ledger.plan({})
    with sqlite3.connect(path) as database:
        ((*_, plan),) = database.execute(f"EXPLAIN QUERY PLAN SELECT rowid, {LISTED} FROM cells")
    assert plan == "SCAN cells USING COVERING INDEX listed"


def test_a_folder_of_a_full_disk_is_a_usage_error(path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("pathlib.Path.mkdir", full)
    with Ledger(path) as ledger, pytest.raises(UsageError, match="No space left on device"):
        ledger.plan({})
