"""`stlbench verify`: what it says, and its exit codes."""

from __future__ import annotations

import json
import sqlite3

import pytest
from helpers.synthetic_results import result
from typer.testing import CliRunner

from stlbench.cli import app
from stlbench.errors import DiskFull
from stlbench.records.ledger import FILE, Ledger


@pytest.fixture
def folder(tmp_path):
    with Ledger(tmp_path / FILE) as ledger:
        for seed in range(3):
            ledger.record(result(seed=seed))
    return tmp_path


def say(*words):
    return CliRunner().invoke(app, ["verify", *map(str, words)])


def damage(folder):
    with sqlite3.connect(folder / FILE) as database:
        database.execute("UPDATE cells SET result = '{}' WHERE seed = 1")
    database.close()


def test_a_whole_folder(folder):
    done = say(folder)
    assert (done.exit_code, done.stdout) == (0, f"{folder}/: 3 rows, 0 files as they were recorded: whole\n")


def test_damage_is_named_and_repaired(folder):
    damage(folder)
    done = say(folder)
    assert done.exit_code == 1
    assert done.stdout.splitlines() == [
        "hold-disc/funnel/dqn/1 quick: row: it does not have the checksum that was recorded with it",
        f"{folder}/: 3 rows, 0 files as they were recorded: 1 with damage",
        "--repair marks the cells, and the `stlbench run` that measured them measures them again",
    ]
    done = say(folder, "--repair")
    assert done.exit_code == 0
    assert "repaired: the `stlbench run` that measured them measures them again" in done.stdout
    assert "1 cell is marked, for the next `stlbench run` to measure again" in say(folder).stdout


def test_as_json(folder):
    damage(folder)
    found = json.loads(say(folder, "--json").stdout)
    assert (found["whole"], found["rows"], found["repaired"]) == (False, 3, False)
    assert [(one["cell"], one["what"]) for one in found["damages"]] == [("hold-disc/funnel/dqn/1 quick", "row")]


def test_a_full_disk_has_a_code_of_its_own(folder, monkeypatch):
    def full(place):
        raise DiskFull("cannot write")

    monkeypatch.setattr("stlbench.records.verify.repair", full)
    done = say(folder, "--repair")
    assert (done.exit_code, done.stderr) == (74, "error: cannot write\n")
