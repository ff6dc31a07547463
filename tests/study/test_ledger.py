"""The ledger: what is written comes back, survives a kill, and no other file is taken for one."""

from __future__ import annotations

import dataclasses
import os
import signal
import sqlite3
import subprocess
import sys

import pytest
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.study.ledger import VERSION, Ledger


@pytest.fixture
def path(tmp_path):
    return tmp_path / "results" / "ledger.sqlite"


def test_what_is_recorded_comes_back_equal_in_order(path):
    recorded = [
        result("raw", 1),
        result("funnel", 10, robustness=(0.1, -0.2)),
        result("funnel", 2, status="killed", reason="killed by signal 9"),
        result("funnel", 0, task="a-task"),
        result("flag", 0, status="intractable", reason="needs 600 inputs, limit 512"),
    ]
    with Ledger(path) as ledger:
        for entry in recorded:
            ledger.record(entry)
    with Ledger(path) as ledger:
        assert list(ledger.results()) == [recorded[3], recorded[4], recorded[2], recorded[1], recorded[0]]


def test_results_of_some_keys_only(path):
    one, other = result(seed=0), result(seed=1)
    with Ledger(path) as ledger:
        ledger.record(one)
        ledger.record(other)
        assert list(ledger.results([other.key, "unknown"])) == [other]
        assert list(ledger.results([])) == []


def test_the_columns_are_there_for_sql(path):
    with Ledger(path) as ledger:
        ledger.record(result("funnel", 3, robustness=(0.5, 0.25, -0.15, 0.2), training_cpu_seconds=7.5))
        ledger.record(result("raw", 3, status="timeout", reason="no result after 3 s"))
    columns = "method, seed, status, reason, robustness_mean, satisfaction, training_cpu_seconds, training_wall_seconds"
    rows = sqlite3.connect(path).execute(f"SELECT {columns} FROM cells ORDER BY method").fetchall()
    assert rows == [
        ("funnel", 3, "done", "", pytest.approx(0.2), 0.75, 7.5, 12.0),
        ("raw", 3, "timeout", "no result after 3 s", None, None, None, None),
    ]


def test_a_key_has_one_row_the_last(path):
    before = result(status="raised", reason="ValueError: x")
    after = dataclasses.replace(result(), key=before.key)
    with Ledger(path) as ledger:
        ledger.record(before)
        ledger.record(after)
        assert list(ledger.results()) == [after]


def test_of_a_cell_measured_again_with_another_key_the_newest_counts(path):
    old, other, budget, new = result(), result(seed=1), result(budget="paper"), result(robustness=(0.5,))
    new = dataclasses.replace(new, key="edited")
    with Ledger(path) as ledger:
        for entry in (old, other, budget, new):
            ledger.record(entry)
        assert {entry.key for entry in ledger.results()} == {"edited", other.key, budget.key}
        assert list(ledger.results([old.key])) == [old]
        ledger.record(old)  # written again, it is the newest
        assert {entry.key for entry in ledger.results()} == {old.key, other.key, budget.key}


def test_accidents_are_finished_unless_they_are_to_be_tried_again(path):
    statuses = ["done", "raised", "timeout", "killed", "intractable", "unsuitable"]
    entries = [result(seed=seed, status=status) for seed, status in enumerate(statuses)]
    keys = {entry.status: entry.key for entry in entries}
    with Ledger(path) as ledger:
        assert ledger.finished(keys.values()) == set()
        for entry in entries:
            ledger.record(entry)
        assert ledger.finished([*keys.values(), "unknown"]) == set(keys.values())
        kept = {keys["done"], keys["intractable"], keys["unsuitable"]}
        assert ledger.finished(keys.values(), retry=True) == kept
        assert ledger.finished([keys["raised"]]) == {keys["raised"]}


KILLED = """
import os, signal, sys
from pathlib import Path
from helpers.synthetic_results import result
from stlbench.study.ledger import Ledger
ledger = Ledger(Path(sys.argv[1]))
for seed in range(20):
    ledger.record(result(seed=seed))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_what_was_recorded_survives_a_kill(path):
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    ended = subprocess.run([sys.executable, "-c", KILLED, path], env=environment, check=False)
    assert ended.returncode == -signal.SIGKILL
    with Ledger(path) as ledger:
        assert [entry.id.seed for entry in ledger.results()] == list(range(20))


def test_a_reader_sees_what_a_writer_has_recorded_meanwhile(path):
    with Ledger(path) as writer, Ledger(path, create=False) as reader:
        for seed in range(3):
            writer.record(result(seed=seed))
            assert len(list(reader.results())) == seed + 1


def test_reading_while_recording(path):
    with Ledger(path) as ledger:
        for seed in range(5):
            ledger.record(result(seed=seed))
        for entry in ledger.results():
            ledger.record(dataclasses.replace(entry, reason="seen"))
        assert [(entry.id.seed, entry.reason) for entry in ledger.results()] == [(seed, "seen") for seed in range(5)]


def other_database(path):
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE cells (key)")


def newer_ledger(path):
    Ledger(path).close()
    with sqlite3.connect(path) as database:
        database.execute(f"PRAGMA user_version = {VERSION + 1}")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path.write_text("some text, and no database\n" * 50), "is no ledger of stlbench"),
        (lambda path: path.write_text("x"), "is no ledger of stlbench"),
        (lambda path: path.write_bytes(b"SQLite format 3\0 and then nonsense" * 50), "cannot read the ledger"),
        (other_database, "is no ledger of stlbench"),
        (newer_ledger, f"is a ledger of version {VERSION + 1}; this stlbench reads version {VERSION}"),
        (lambda path: path.mkdir(), "unable to open database file"),
    ],
)
def test_another_file_is_refused_and_left_as_it_is(tmp_path, make, message):
    path = tmp_path / "ledger.sqlite"
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(UsageError) as caught:
        Ledger(path)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)
    assert (path.read_bytes() if path.is_file() else None) == before


def test_a_reader_makes_no_file(path):
    with pytest.raises(UsageError, match="there is no ledger at"):
        Ledger(path, create=False)
    assert not path.parent.exists()


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="cannot open the ledger"):
        Ledger(tmp_path / "file" / "ledger.sqlite")
