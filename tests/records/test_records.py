"""Damage anywhere in the file of a ledger: what is damaged is named, and all else is read."""

from __future__ import annotations

import sqlite3
import warnings

import numpy as np
import pytest
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records.ledger import Ledger
from stlbench.records.reader import LedgerWarning
from stlbench.records.status import ACCIDENTS

COUNT = 14


@pytest.fixture
def whole(tmp_path):
    path = tmp_path / "ledger.sqlite"
    entries = [result(seed=seed) for seed in range(COUNT)]
    with Ledger(path) as ledger:
        ledger.plan({entry.key: entry.id for entry in (*entries, result(seed=COUNT))})
        for entry in entries:
            ledger.record(entry)
    database = sqlite3.connect(path)
    (size,) = database.execute("PRAGMA page_size").fetchone()
    database.close()
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
        ledger.lost()
        list(ledger.recorded())
        problems = ledger.problems()
    assert all(issubclass(one.category, LedgerWarning) for one in said)
    assert all("is damaged and passed over; `stlbench verify" in str(one.message) for one in said)
    return seeds, missing, {str(one.message) for one in said}, problems


def test_nothing_is_said_of_a_whole_one(whole):
    assert read(whole[0]) == (list(range(COUNT)), [COUNT], set(), [])


@pytest.mark.parametrize("how", ["zeros", "noise"])
def test_a_damaged_page_anywhere_costs_what_is_in_it_and_no_more(whole, how):
    path, size = whole
    content = path.read_bytes()
    costs = []
    for page in range(1, len(content) // size):
        other = bytes(size) if how == "zeros" else np.random.default_rng(page).bytes(size)
        path.write_bytes(content[: page * size] + other + content[(page + 1) * size :])
        seeds, missing, said, problems = read(path)
        assert seeds == sorted(set(seeds))
        assert problems
        assert said or len(seeds) == COUNT
        costs.append(COUNT - len(seeds))
        if COUNT not in missing:
            assert any("a part of the plan" in line for line in said)
    assert max(costs) <= 10 or costs.count(COUNT) <= 1  # at most the one page that leads to all others of the table
    assert sorted(costs)[len(costs) // 2] <= 4


def test_the_first_page_says_what_the_file_is_and_without_it_nothing_is_read(whole):
    path, size = whole
    content = path.read_bytes()
    path.write_bytes(content[:100] + bytes(size - 100) + content[size:])
    with pytest.raises(UsageError, match=r"ledger\.sqlite"):
        Ledger(path, create=False)


@pytest.mark.parametrize(
    ("column", "value"),
    [
        *(("result", text) for text in ("'{\"key\": '", "'[]'", "x'ff00'", "3", "replace(result, '0.3', '0.8')")),
        *(("task", "'NO NAME'"), ("seed", "'x'"), ("agent", "x'00ff'")),
    ],
)
def test_a_damaged_row_is_named_and_passed_over_and_measured_again_by_retry(whole, column, value):
    """One without a cell is named by its key."""
    path, _ = whole
    with sqlite3.connect(path) as database:
        database.execute(f"UPDATE cells SET {column} = {value} WHERE seed = 7")
    database.close()
    seeds, _, said, _ = read(path)
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
