"""A row is checked when it is read: one that no run writes is left out with a warning, and the others are there."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
from helpers.impossible_rows import IMPOSSIBLE, changed, insert, plain, rich, several
from helpers.ledgers import say
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records import array_files
from stlbench.records.array_files import Assessment, read_cell, read_saved, save_traces
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import from_json, to_json
from stlbench.records.result_files import cell_files
from stlbench.records.rows import LedgerWarning
from stlbench.records.upkeep import verify


@pytest.fixture
def folder(tmp_path):
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.record(result())
    return tmp_path


def read(folder):
    with warnings.catch_warnings(record=True) as caught, Ledger(folder / LEDGER, create=False) as ledger:
        warnings.simplefilter("always")
        return list(ledger.results()), [str(each.message) for each in caught]


@pytest.mark.parametrize("made", several(), ids=lambda made: made.status)
def test_what_a_run_writes_comes_back(made):
    assert from_json(to_json(made)) == made


@pytest.mark.parametrize("wrong", IMPOSSIBLE)
def test_an_impossible_row_is_left_out_with_a_warning_and_the_others_are_read(folder, wrong):
    row = plain(rich())
    insert(folder, changed(row, IMPOSSIBLE[wrong]), row)
    results, (warning,) = read(folder)
    assert results == [result()]
    assert f"{folder / LEDGER}: the row of " in warning
    assert "is damaged and passed over" in warning
    assert len(warning) < 500


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("no robustness of any start", "measurement.selected.formula: it is of no start"),
        ("no score by the formula", "measurement: selected has no score by the protocol formula"),
        ("a protocol of one policy alone", "measurement: selected and final have other protocols"),
        ("more steps than there can be", "measurement.env_steps: should be less than 9007199254740992"),
        ("less than no time", "measurement.cpu_seconds: should be at least 0"),
        ("a text in the place of a number", "measurement.env_steps: should be a whole number"),
        ("done and not measured", "a cell has a measurement exactly where its status is done"),
        ("a key with NUL", "key: should be one line of characters that can be shown"),
        ("a task that is a path", "id.task: should be a text"),
        ("a hash that is none", "measurement.policies.selected: should match pattern"),
    ],
)
def test_the_warning_says_which_rule_is_broken_and_where(wrong, said):
    with pytest.raises(ValueError, match=r"^[^\n]*$") as caught:
        from_json(json.dumps(changed(plain(rich()), IMPOSSIBLE[wrong])))
    assert said in str(caught.value)


def test_verify_names_an_impossible_row(folder):
    row = plain(rich())
    insert(folder, changed(row, IMPOSSIBLE["no score of the final policy"]), row)
    (damage,) = verify(folder).damages
    assert (damage.what, damage.cell) == ("row", rich().id)
    assert "selected and final have other protocols" in damage.problem


def test_a_row_whose_columns_say_another_cell_is_left_out(folder):
    """Else the cell would be there twice."""
    insert(folder, plain(result()), {**plain(result()), "seed": 5})
    insert(folder, {**plain(result()), "key": "k"}, plain(result()))
    say(folder / LEDGER, "UPDATE cells SET seed = 7 WHERE key = 'k'")
    results, said = read(folder)
    assert results == [result()]
    assert "its columns do not say what its result says" in said[0]


@pytest.mark.parametrize(
    ("column", "value"),
    [("failures", "many"), ("failures", -1), ("again", "x"), ("key", b"\xff"), ("seed", -1), ("budget", "a\x1bb")],
)
def test_an_impossible_column_is_left_out_with_a_warning(folder, column, value):
    insert(folder, plain(rich()), plain(rich()))
    say(folder / LEDGER, f"UPDATE cells SET {column} = ? WHERE key = ?", values=(value, rich().key))
    results, said = read(folder)
    assert results == [result()]
    assert len(said) == 1
    with Ledger(folder / LEDGER, create=False) as ledger, warnings.catch_warnings():
        warnings.simplefilter("ignore", LedgerWarning)
        assert ledger.given_up([rich().key, result().key], 1) == []


def test_text_that_is_no_utf_8_is_damage(folder):
    """SQLite takes any bytes for a text."""
    insert(folder, plain(rich()), plain(rich()))
    say(folder / LEDGER, "UPDATE cells SET reason = CAST(X'FF' AS TEXT), method = CAST(X'66FF' AS TEXT) WHERE seed = 0")
    say(folder / LEDGER, "UPDATE cells SET method = 'funnel' WHERE key = ?", values=(result().key,))
    results, said = read(folder)
    assert results == [result()]
    assert len(said) == 1


def test_a_schema_that_is_no_utf_8_is_refused_in_one_line(folder):
    """SQLite quotes the damaged name in its error."""
    file = folder / LEDGER
    data = file.read_bytes()
    assert data.count(b"INDEX listed ON cells") == 1
    file.write_bytes(data.replace(b"INDEX listed ON cells", b"INDEX \x9aisted ON \xffells"))
    with pytest.raises(UsageError, match="cannot read the ledger"):
        Ledger(file, create=False)


def test_traces_of_other_starts_than_the_row_says_are_refused(tmp_path):
    made = result(robustness=[1.0] * 1000)
    save_traces(cell_files(tmp_path, made.id, made.key).traces, Assessment({}, np.zeros((8, 3, 1)), None), ("x",))
    with pytest.raises(UsageError, match="traces from 8 starts, and its row says 1000"):
        read_cell(tmp_path, made)


@pytest.mark.parametrize(
    ("extremes", "states"),
    [
        ([0, 8], np.zeros((2, 3, 1))),
        ([0, -1], np.zeros((2, 3, 1))),
        ([0.0, 1.0], np.zeros((2, 3, 1))),
        ([0], np.zeros((2, 3, 1))),
        ([0, 1], np.zeros((2, 1, 1))),
        ([0, 1], np.zeros(2)),
    ],
)
def test_states_that_are_of_no_film_are_refused(tmp_path, extremes, states):
    named = {"traces": np.zeros((8, 3, 1)), "signals": np.array(["x"])}
    array_files.write_arrays(tmp_path / "x.npz", {**named, "extremes": np.array(extremes), "states": states})
    with pytest.raises(UsageError, match="extremes are numbers of starts"):
        read_saved(tmp_path / "x.npz")


def test_a_count_of_failures_that_cannot_be_begins_again(folder):
    failed = result("mine", status="raised")
    for count in ("many", -5, 2**63 - 1):
        insert(folder, plain(failed), plain(failed))
        say(folder / LEDGER, "UPDATE cells SET failures = ? WHERE key = ?", values=(count, failed.key))
        with Ledger(folder / LEDGER) as ledger:
            ledger.record(failed)
            assert ledger.given_up([failed.key], 1) == [failed.id]
            assert ledger.given_up([failed.key], 2) == []
