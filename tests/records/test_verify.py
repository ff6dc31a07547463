"""A folder of results is compared with its checksums; what is not as it was recorded is measured again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers import scripted_cells
from helpers.ledgers import say
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records import array_files, results_folder
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.lines import write_lines
from stlbench.records.result import StoredPolicies
from stlbench.records.result_files import LINES, cell_files
from stlbench.records.upkeep import merge, remove, repair, verify


def keyed(seed):
    return replace(result(seed=seed), key=f"{seed:032}")


@pytest.fixture
def folder(tmp_path):
    """Three cells, with files that say what they are."""
    place = tmp_path / "results"
    with Ledger(place / LEDGER) as ledger:
        entries = [keyed(seed) for seed in range(3)]
        ledger.plan({entry.key: entry.id for entry in entries})
        for entry in entries:
            for file in cell_files(place, entry.id, entry.key):
                file.parent.mkdir(exist_ok=True)
                file.write_text(f"{file.parent.name} of {entry.id.seed}")
            ledger.record(entry)
    return place


def said(found):
    return [(damage.name, damage.what, damage.problem) for damage in found.damages]


def test_a_whole_folder(folder):
    found = verify(folder)
    assert (found.rows, found.files, found.is_whole) == (3, 6, True)
    assert repair(folder) == found
    with Ledger(folder / LEDGER) as ledger:
        assert len(ledger.finished(keyed(seed).key for seed in range(3))) == 3


def deleted(folder, rule="1", table="cells"):
    say(folder / LEDGER, f"DELETE FROM {table} WHERE {rule}")


@pytest.mark.parametrize(("rule", "seeds"), [("seed = 1", [1]), ("seed < 2", [0, 1]), ("1", [0, 1, 2])])
@pytest.mark.parametrize("planned", [True, False])
def test_rows_that_were_deleted_are_named(folder, rule, seeds, planned):
    deleted(folder, rule)
    if not planned:
        deleted(folder, table="planned")
    found = verify(folder)
    expected = [(f"hold-disc/funnel/dqn/{seed} quick", "row", "it was recorded, and is not there") for seed in seeds]
    assert (found.rows, said(found), found.is_whole) == (3 - len(seeds), expected, False)
    assert said(repair(folder)) == expected
    assert verify(folder).is_whole
    with Ledger(folder / LEDGER) as ledger:
        assert [cell.seed for cell in ledger.missing()] == seeds  # the next run measures them
        ledger.record(keyed(seeds[0]))
    assert (verify(folder).rows, verify(folder).is_whole) == (4 - len(seeds), True)


def test_rows_that_are_measured_again_are_there_again(folder):
    deleted(folder)
    with Ledger(folder / LEDGER) as ledger:
        for seed in range(3):
            ledger.record(keyed(seed))
    assert verify(folder).is_whole


def test_what_was_removed_put_together_or_copied_is_no_damage(folder, tmp_path):
    remove(folder, [keyed(1).id])
    merge(tmp_path / "merged", folder)
    for place, rows in ((folder, 2), (tmp_path / "merged", 2)):
        assert (verify(place).rows, verify(place).is_whole) == (rows, True)


def test_a_ledger_without_rows_is_empty_and_whole(tmp_path):
    """As that of a run that was killed before its first row; its files have the keys of the plan."""
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.plan({keyed(0).key: keyed(0).id})
    for path in cell_files(tmp_path, keyed(0).id, keyed(0).key):
        path.parent.mkdir()
        path.write_text("half a cell")
    assert (verify(tmp_path).rows, verify(tmp_path).is_whole) == (0, True)
    assert repair(tmp_path).is_whole


def test_an_older_ledger_is_read_and_lists_its_rows_when_it_is_written(folder):
    """As stlbench wrote it before it listed the rows that it has recorded."""
    say(folder / LEDGER, "DROP TABLE recorded", "PRAGMA user_version = 5")
    before = (folder / LEDGER).read_bytes()
    assert (verify(folder).rows, verify(folder).is_whole) == (3, True)
    assert [entry.id.seed for entry in results_folder.read(folder)] == [0, 1, 2]
    assert (folder / LEDGER).read_bytes() == before
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(keyed(3))
    deleted(folder, "seed IN (1, 3)")
    assert [damage.cell.seed for damage in verify(folder).damages] == [1, 3]


def test_a_list_of_rows_that_is_gone_is_damage(folder):
    say(folder / LEDGER, "DROP TABLE recorded")
    assert verify(folder).structure == ("it does not list the rows that were recorded",)
    with pytest.raises(UsageError, match=r"is damaged; take the file away, and the results are read from cells\.jsonl"):
        repair(folder)


def test_what_is_missing_or_other_is_named_and_marked_and_its_result_stays(folder):
    beside = [cell_files(folder, keyed(seed).id, keyed(seed).key) for seed in range(3)]
    beside[0].traces.unlink()
    beside[1].policies.write_text("of another")
    expected = [
        ("hold-disc/funnel/dqn/0 quick", "traces", f"{beside[0].traces} is missing"),
        ("hold-disc/funnel/dqn/1 quick", "policies", f"{beside[1].policies} is not as it was recorded"),
    ]
    found = verify(folder)
    assert said(found) == expected
    assert (found.files, found.is_whole, found.marked) == (4, False, 0)
    assert said(repair(folder)) == expected
    assert verify(folder).marked == 2
    with Ledger(folder / LEDGER) as ledger:
        assert len(list(ledger.results())) == 3
        assert ledger.finished(keyed(seed).key for seed in range(3)) == {keyed(2).key}
        beside[0].traces.write_text("measured again")
        ledger.record(keyed(0))
        assert ledger.finished(keyed(seed).key for seed in range(3)) == {keyed(0).key, keyed(2).key}
    assert [name for name, _, _ in said(verify(folder))] == [expected[1][0]]


def test_a_row_that_is_not_as_it_was_recorded(folder):
    say(folder / LEDGER, "UPDATE cells SET result = replace(result, '0.4', '0.9') WHERE seed = 1")
    (damage,) = verify(folder).damages
    assert (damage.what, damage.cell.seed) == ("row", 1)
    repair(folder)
    with Ledger(folder / LEDGER) as ledger:
        assert ledger.finished(keyed(seed).key for seed in range(3)) == {keyed(0).key, keyed(2).key}


@pytest.mark.filterwarnings("ignore::stlbench.records.rows.LedgerWarning")
@pytest.mark.parametrize(
    "column",
    [
        *("seed='x'", "seed=7", "track=''", "budget=''", "method='a/b'", "status='x'", "key='k'"),
        *("robustness_mean=99", "satisfaction='x'", "reason='why'"),
    ],
)
def test_a_row_whose_columns_say_another_thing_than_its_result(folder, column):
    say(folder / LEDGER, f"UPDATE cells SET {column} WHERE seed = 1")
    problem = "its columns do not say what its result says"
    assert said(verify(folder)) == [("hold-disc/funnel/dqn/1 quick", "row", problem)]
    repair(folder)
    with Ledger(folder / LEDGER) as ledger:
        assert ledger.finished(keyed(seed).key for seed in range(3)) == {keyed(0).key, keyed(2).key}
        ledger.record(keyed(1))
    assert verify(folder).is_whole
    with Ledger(folder / LEDGER) as ledger:
        assert [entry.id.seed for entry in ledger.results()] == [0, 1, 2]


def test_the_next_run_measures_exactly_what_was_damaged(tmp_path, scripted):
    cells, again = scripted_cells.cells("a", "b", "c"), scripted_cells.Here()
    scripted_cells.run_cells(cells, tmp_path, scripted_cells.Here())
    say(tmp_path / LEDGER, "UPDATE cells SET result = '{}' WHERE seed = 1")
    repair(tmp_path)
    scripted_cells.run_cells(cells, tmp_path, again)
    assert again.ran == [("b", 60)]
    assert verify(tmp_path).is_whole


def test_a_folder_of_lines_and_none_at_all(tmp_path):
    with pytest.raises(UsageError, match="there is no ledger"):
        verify(tmp_path)
    write_lines([keyed(0)], tmp_path / LINES)
    assert (verify(tmp_path).rows, verify(tmp_path).is_whole) == (1, True)


def test_the_policies_beside_lines_are_compared_with_their_hashes(tmp_path):
    arrays = {"selected": {"a": np.zeros(3)}, "final": {"a": np.ones(3)}}
    hashes = StoredPolicies(*map(array_files.digest, arrays.values()), 4)
    one, other = keyed(0), replace(keyed(1), measurement=replace(keyed(1).measurement, policies=hashes))
    write_lines([one, other], tmp_path / LINES)
    assert (verify(tmp_path).rows, verify(tmp_path).files, verify(tmp_path).is_whole) == (2, 0, True)
    path = cell_files(tmp_path, other.id, other.key).policies
    for final in ({"final/a": arrays["final"]["a"]}, {}):  # the final one may be left out
        array_files.write_arrays(path, {"selected/a": arrays["selected"]["a"], **final})
        for place in (tmp_path, tmp_path / LINES):
            assert (verify(place).rows, verify(place).files, verify(place).is_whole) == (2, 1, True)
    content = path.read_bytes()
    for wrong in ({"selected/a": np.ones(3)}, {"selected/a": np.zeros(3), "final/a": np.zeros(3)}):
        array_files.write_arrays(path, wrong)
        (damage,) = verify(tmp_path).damages
        assert (damage.cell, damage.what) == (other.id, "policies")
        assert "its hash is not the recorded one" in damage.problem
    path.write_bytes(content[:-30])
    assert len(verify(tmp_path).damages) == 1
    with pytest.raises(UsageError, match=r"but cells\.jsonl; take damaged files from where they came"):
        repair(tmp_path)


def test_repair_makes_no_folder_that_was_mistyped(tmp_path):
    with pytest.raises(UsageError, match="there is no ledger at"):
        repair(tmp_path / "typo")
    assert not (tmp_path / "typo").exists()


def test_lines_that_cannot_be_read_are_named_and_written_anew(folder):
    with Ledger(folder / LEDGER) as ledger:
        ledger.plan_also({keyed(3).key: keyed(3).id})
    whole = (folder / LINES).read_text()
    damaged = whole.replace('"status": "done"', '"status": "d', 1)
    (folder / LINES).write_text(damaged)
    found = verify(folder)
    assert (found.is_whole, found.damages, f"{folder / LINES}, line 1: not a result" in found.lines) == (
        False,
        (),
        True,
    )
    say(folder / LEDGER, "UPDATE cells SET result = '{}' WHERE seed = 1")
    repair(folder)
    assert (folder / LINES).read_text() == damaged  # it may have the result of the damaged row
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(keyed(1))
    assert repair(folder).lines == found.lines
    assert verify(folder).is_whole
    planned = results_folder.missing(folder)
    (folder / LEDGER).unlink()
    assert [entry.id.seed for entry in results_folder.read(folder)] == [0, 1, 2]
    assert results_folder.missing(folder) == planned == {keyed(3).key: keyed(3).id}
    assert verify(folder).is_whole
