"""Damage anywhere in the file of a ledger: one line says it and the ways out, and the lines beside it have all."""

from __future__ import annotations

import sqlite3
import warnings
from contextlib import closing

import numpy as np
import pytest
from helpers.ledgers import say
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records import results_folder
from stlbench.records.ledger import Ledger
from stlbench.records.result import ACCIDENTS
from stlbench.records.result_files import LINES
from stlbench.records.rows import LedgerWarning
from stlbench.records.upkeep import repair, verify

COUNT = 14


@pytest.fixture
def whole(tmp_path):
    path = tmp_path / "ledger.sqlite"
    entries = [result(seed=seed) for seed in range(COUNT)]
    with Ledger(path) as ledger:
        ledger.plan({entry.key: entry.id for entry in (*entries, result(seed=COUNT))})
        for entry in entries:
            ledger.record(entry)
    with closing(sqlite3.connect(path)) as database:
        (size,) = database.execute("PRAGMA page_size").fetchone()
    return path, size


def read(path):
    """The seeds that are found, what is missing, and how many things were said to be damaged."""
    keys = [result(seed=seed).key for seed in range(COUNT + 1)]
    with warnings.catch_warnings(record=True) as said, Ledger(path, create=False) as ledger:
        warnings.simplefilter("always")
        seeds = [entry.id.seed for entry in ledger.results()]
        missing = [cell.seed for cell in ledger.missing()]
        ledger.finished(keys, ACCIDENTS, 3)
        ledger.counted()
        list(ledger.inspected())
    assert all(issubclass(one.category, LedgerWarning) for one in said)
    assert all("is damaged and passed over; `stlbench verify" in str(one.message) for one in said)
    return seeds, missing, {str(one.message) for one in said}


def test_nothing_is_said_of_a_whole_one(whole):
    assert read(whole[0]) == (list(range(COUNT)), [COUNT], set())
    assert verify(whole[0].parent).is_whole


@pytest.mark.parametrize("how", ["zeros", "noise"])
def test_a_damaged_page_anywhere_is_one_line_with_the_ways_out(whole, how):
    path, size = whole
    content, refused = path.read_bytes(), 0
    for page in range(1, len(content) // size):
        other = bytes(size) if how == "zeros" else np.random.default_rng(page).bytes(size)
        path.write_bytes(content[: page * size] + other + content[(page + 1) * size :])
        problem = ""
        try:
            assert read(path) == (list(range(COUNT)), [COUNT], set())
        except UsageError as error:
            problem = str(error)
        if problem:
            refused += 1
            assert problem.startswith(f"cannot read the ledger {path}: ")
            assert f"; take the file away, and the results are read from {LINES} beside it; or SQLite's own" in problem
            assert f"`sqlite3 {path} .recover | sqlite3 {path.with_name('new-ledger.sqlite')}`" in problem
        assert verify(path.parent).structure
        with pytest.raises(UsageError, match="is damaged; take the file away, and"):
            repair(path.parent)
    assert refused >= len(content) // size - 5
    path.unlink()
    assert [entry.id.seed for entry in results_folder.read(path.parent)] == list(range(COUNT))


def test_the_first_page_says_what_the_file_is_and_without_it_nothing_is_read(whole):
    path, size = whole
    content = path.read_bytes()
    path.write_bytes(content[:100] + bytes(size - 100) + content[size:])
    with pytest.raises(UsageError, match=r"cannot read the ledger .*: database disk image is malformed; take the file"):
        Ledger(path, create=False)


def test_what_writes_into_a_damaged_ledger_says_the_same(whole):
    path, size = whole
    content = path.read_bytes()
    path.write_bytes(content[:size] + bytes(size) + content[2 * size :])
    with Ledger(path) as ledger, pytest.raises(UsageError, match=r"cannot write the ledger .*; take the file"):
        ledger.record(result(seed=COUNT))
    path.unlink()
    assert [entry.id.seed for entry in results_folder.read(path.parent)] == list(range(COUNT + 1))


@pytest.mark.parametrize(
    ("column", "value"),
    [
        *(("result", text) for text in ("'{\"key\": '", "'[]'", "x'ff00'", "3", "replace(result, '0.3', '0.8')")),
        *(("task", "'NO NAME'"), ("seed", "'x'"), ("agent", "x'00ff'"), ("method", "CAST(x'66ff' AS TEXT)")),
    ],
)
def test_a_damaged_row_is_named_and_passed_over_and_measured_again_by_retry(whole, column, value):
    """One without a cell is named by its key."""
    path, _ = whole
    say(path, f"UPDATE cells SET {column} = {value} WHERE seed = 7")
    seeds, _, said = read(path)
    assert len(seeds) == COUNT - 1
    if column != "result":
        assert any("the row of" in line for line in said)
        return
    assert any("the row of hold-disc/funnel/dqn/7 is damaged" in line for line in said)
    keys = {result(seed=seed).key for seed in range(COUNT)}
    with Ledger(path) as ledger:
        assert ledger.finished(keys) == keys
        with pytest.warns(LedgerWarning):
            assert ledger.finished(keys, retry=ACCIDENTS) == keys - {result(seed=7).key}
