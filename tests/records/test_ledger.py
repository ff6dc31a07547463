"""The ledger: what is written comes back, survives a kill, and no other file is taken for one."""

from __future__ import annotations

import dataclasses
import errno
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from helpers.ledgers import say
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records.ledger import Ledger
from stlbench.records.result import ACCIDENTS
from stlbench.records.result_files import LINES
from stlbench.records.schema import LISTED, OLDEST, VERSION


@pytest.fixture
def path(tmp_path):
    return tmp_path / "results" / "ledger.sqlite"


def test_what_is_recorded_comes_back_equal_in_order_and_the_last_of_a_key_alone(path):
    recorded = [
        result("raw", 1),
        result("funnel", 10, robustness=(0.1, -0.2)),
        result("funnel", 2, status="killed", reason="killed by signal 9"),
        result("funnel", 0, task="a-task"),
        result("flag", 0, status="intractable", reason="needs 600 inputs, limit 512"),
    ]
    with Ledger(path) as ledger:
        ledger.record(dataclasses.replace(recorded[0], status="raised", reason="ValueError: x", measurement=None))
        for entry in recorded:
            ledger.record(entry)
    with Ledger(path) as ledger:
        assert list(ledger.results()) == [recorded[3], recorded[4], recorded[2], recorded[1], recorded[0]]
        assert list(ledger.results([recorded[1].key, "unknown"])) == [recorded[1]]
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
        assert ledger.finished(keys.values(), retry=ACCIDENTS) == kept
        assert ledger.finished([keys["raised"]]) == {keys["raised"]}


KILLED = """
import os, signal, sys
from pathlib import Path
from helpers.synthetic_results import result
from stlbench.records.ledger import Ledger
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
    with Ledger(path) as ledger:
        ledger.plan({})
    with Ledger(path) as writer, Ledger(path, create=False) as reader:
        for seed in range(3):
            writer.record(result(seed=seed))
            assert len(list(reader.results())) == seed + 1


def plan(*results):
    return {entry.key: entry.id for entry in results}


def test_what_was_planned_and_has_no_result_is_missing(path):
    entries = [result(method, seed) for method in ("raw", "funnel[ginf=0.1]") for seed in (10, 2)]
    with Ledger(path) as ledger:
        ledger.plan(plan(*entries))
        assert ledger.missing() == sorted(entry.id for entry in entries)
        ledger.record(entries[0])
        ledger.record(dataclasses.replace(entries[1], status="raised", measurement=None))
    with Ledger(path, create=False) as ledger:
        assert ledger.missing() == [entries[3].id, entries[2].id]
        assert len(list(ledger.results())) == 2


def test_a_later_plan_replaces_that_of_the_same_settings_and_of_no_other(path):
    other, budget, many = result("raw"), result(budget="paper"), [result(seed=seed) for seed in range(100)]
    with Ledger(path) as ledger:
        ledger.plan(plan(other, budget, *many))
        ledger.plan(plan(*many[:2]))
        assert set(ledger.missing()) == {entry.id for entry in (other, budget, *many[:2])}


def test_of_several_results_of_a_cell_the_planned_one_counts(path):
    """And where a plugin was edited, a result that is not of today's plan is one all the same."""
    old, new = result(), dataclasses.replace(result(robustness=(0.5,)), key="edited")
    with Ledger(path) as ledger:
        ledger.record(old)
        ledger.plan(plan(new))
        assert ledger.missing() == []
        ledger.record(new)
        assert list(ledger.results()) == [new]
        ledger.plan(plan(old))  # the edit was taken back
        assert list(ledger.results()) == [old]
        ledger.plan(plan(new))
        assert list(ledger.results()) == [new]


def test_nothing_is_made_before_something_is_written(path):
    with Ledger(path) as ledger:
        assert (list(ledger.results()), ledger.missing(), ledger.finished(["key"])) == ([], [], set())
    assert not path.parent.exists()
    with Ledger(path) as ledger:
        ledger.record(result())
        assert list(ledger.results()) == [result()]


def test_reading_while_recording(path):
    with Ledger(path) as ledger:
        for seed in range(5):
            ledger.record(result(seed=seed))
        for entry in ledger.results():
            ledger.record(dataclasses.replace(entry, reason="seen"))
        assert [(entry.id.seed, entry.reason) for entry in ledger.results()] == [(seed, "seen") for seed in range(5)]


def of_version(version):
    def make(path):
        with Ledger(path) as ledger:
            ledger.record(result())
        say(path, f"PRAGMA user_version = {version}")

    return make


OTHER = f"is a ledger of version {{}}; this stlbench reads {OLDEST} to {VERSION}"


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path.write_text("some text, and no database\n" * 50), "is no ledger of stlbench"),
        (lambda path: path.write_text("x"), "is no ledger of stlbench"),
        (lambda path: path.write_bytes(b"SQLite format 3\0 and then nonsense" * 50), "cannot read the ledger"),
        (lambda path: say(path, "CREATE TABLE cells (key)"), "is no ledger of stlbench"),
        (lambda path: path.mkdir(), "is no ledger of stlbench"),
        *((of_version(version), OTHER.format(version)) for version in (OLDEST - 1, VERSION + 1)),
        (lambda path: None, "there is no ledger at"),
    ],
)
def test_another_file_is_refused_and_left_as_it_is(tmp_path, make, message):
    path = tmp_path / "ledger.sqlite"
    make(path)
    before = path.read_bytes() if path.is_file() else None
    with pytest.raises(UsageError) as caught:
        Ledger(path, create=False)
    assert str(path) in str(caught.value)
    assert message in str(caught.value)
    assert (path.read_bytes() if path.is_file() else None) == before


def test_what_is_missing_is_found_in_the_index_alone(path):
    with Ledger(path) as ledger:
        ledger.plan({})
    with sqlite3.connect(path) as database:
        ((*_, found),) = database.execute(f"EXPLAIN QUERY PLAN SELECT rowid, {LISTED} FROM cells")
    assert found == "SCAN cells USING COVERING INDEX listed"


def test_a_folder_that_cannot_be_made_or_is_on_a_full_disk(path, monkeypatch):
    def full(*_, **__):
        raise OSError(errno.ENOSPC, "No space left on device")

    path.parent.touch()
    with Ledger(path) as ledger, pytest.raises(UsageError, match="cannot open the ledger"):
        ledger.plan({})
    path.parent.unlink()
    monkeypatch.setattr("pathlib.Path.mkdir", full)
    with Ledger(path) as ledger, pytest.raises(UsageError, match="No space left on device"):
        ledger.plan({})


def copied(path, folder, *names):
    """Some of the files beside a ledger, in another folder, as someone leaves them there."""
    folder.mkdir()
    for name in names:
        (folder / name).write_bytes((path.parent / name).read_bytes())
    return folder / path.name


def test_what_is_recorded_is_in_the_one_file_at_once(path, tmp_path):
    """Whatever else SQLite has written beside it, while the ledger is still open."""
    with Ledger(path) as ledger:
        for seed in range(3):
            ledger.record(result(seed=seed))
            with Ledger(copied(path, tmp_path / str(seed), path.name), create=False) as copy:
                assert len(list(copy.results())) == seed + 1
        assert sorted(file.name for file in path.parent.iterdir()) == [LINES, path.name]


HALF_WRITTEN = """
import os, signal, sqlite3, sys
database = sqlite3.connect(sys.argv[1], isolation_level=None)
database.execute("PRAGMA cache_size = 1")  # what it changes goes to the file at once
database.execute("BEGIN IMMEDIATE")
database.execute("DELETE FROM cells")
rows = [(f"half written {k}", "t", "m", "a", k, "quick", "shared") for k in range(500)]
database.executemany("INSERT INTO planned VALUES (?, ?, ?, ?, ?, ?, ?)", rows)
os.kill(os.getpid(), signal.SIGKILL)
"""


def killed_while_writing(path):
    """A file that a transaction has changed in part, and beside it the journal that says how it was."""
    subprocess.run([sys.executable, "-c", HALF_WRITTEN, path], check=False)
    assert path.with_name(f"{path.name}-journal").stat().st_size
    assert b"half written" in path.read_bytes()


def test_what_a_killed_run_had_half_written_is_taken_back_by_who_reads(path):
    with Ledger(path) as ledger:
        ledger.plan(plan(result(), result(seed=1)))
        ledger.record(result())
    killed_while_writing(path)
    with Ledger(path, create=False) as ledger:
        assert list(ledger.results()) == [result()]
        assert len(ledger.missing()) == 1
    assert sorted(file.name for file in path.parent.iterdir()) == [LINES, path.name]


UNPRIVILEGED = """
import os, sys
from pathlib import Path
from stlbench.records.ledger import Ledger
def read(path):
    with Ledger(Path(path), create=False) as ledger:
        return len(list(ledger.results())), len(ledger.missing())
read(sys.argv[1])  # all is imported: one who has no rights may not even read this installation
if os.getuid() == 0:
    os.setgid(65534)
    os.setuid(65534)
assert not os.access(Path(sys.argv[2]).parent, os.W_OK)
print(*read(sys.argv[2]))
"""


@pytest.mark.parametrize("mode", ["delete", "killed"])
def test_a_folder_that_cannot_be_written_can_be_read(path, mode):
    with Ledger(path) as ledger:
        ledger.plan(plan(result(), result(seed=1)))
        ledger.record(result())
    with tempfile.TemporaryDirectory() as folder:  # pytest's own folders are for one user alone
        shown = copied(path, Path(folder) / "results", path.name)
        if mode == "killed":
            killed_while_writing(shown)
        Path(folder).chmod(0o755)
        shown.parent.chmod(0o555)
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
        command = [sys.executable, "-c", UNPRIVILEGED, path, shown]
        ran = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        shown.parent.chmod(0o755)
    assert ran.stdout == "1 1\n", ran.stderr


def test_a_fresh_ledger_takes_any_number_of_cells(path, monkeypatch):
    """The guard on the opening of a stranger's file is none on what is written into a new one."""
    monkeypatch.setattr("stlbench.records.schema._OPENING", 3_000)
    results = [result("raw", seed) for seed in range(60)]
    with Ledger(path) as ledger:
        ledger.plan({one.key: one.id for one in results})
        for one in results:
            ledger.record(one)
        assert len(list(ledger.results())) == 60
