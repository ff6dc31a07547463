"""A folder of results is compared with its checksums; what is not as it was recorded is measured again."""

from __future__ import annotations

import sqlite3
from dataclasses import replace

import pytest
from helpers import scripted_cells
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records import stored
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.outputs import cell_files
from stlbench.records.verify import DAMAGED, repair, verify
from stlbench.study import run


def keyed(seed):
    return replace(result(seed=seed), key=f"{seed:032}")


@pytest.fixture
def folder(tmp_path):
    """Three cells, with files that say what they are."""
    place = tmp_path / "results"
    with Ledger(place / FILE) as ledger:
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
    with Ledger(folder / FILE) as ledger:
        assert len(ledger.finished(keyed(seed).key for seed in range(3))) == 3


def test_no_result_beside_files_is_not_whole(folder):
    with sqlite3.connect(folder / FILE) as database:
        database.execute("DELETE FROM cells")
    found = verify(folder)
    assert not found.is_whole
    assert found.structure == ("it has no result beside 6 files of traces and policies",)


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
    with Ledger(folder / FILE) as ledger:
        assert len(list(ledger.results())) == 3
        assert ledger.finished(keyed(seed).key for seed in range(3)) == {keyed(2).key}
        beside[0].traces.write_text("measured again")
        ledger.record(keyed(0))
        assert ledger.finished(keyed(seed).key for seed in range(3)) == {keyed(0).key, keyed(2).key}
    assert [name for name, _, _ in said(verify(folder))] == [expected[1][0]]


def test_a_row_that_is_not_as_it_was_recorded(folder):
    with sqlite3.connect(folder / FILE) as database:
        database.execute("UPDATE cells SET result = replace(result, '0.4', '0.9') WHERE seed = 1")
    database.close()
    (damage,) = verify(folder).damages
    assert (damage.what, damage.cell.seed) == ("row", 1)
    repair(folder)
    with Ledger(folder / FILE) as ledger:
        assert ledger.finished(keyed(seed).key for seed in range(3)) == {keyed(0).key, keyed(2).key}


@pytest.mark.filterwarnings("ignore::stlbench.records.reader.LedgerWarning")
@pytest.mark.parametrize(
    "column", ["seed='x'", "seed=7", "track=''", "budget=''", "method='a/b'", "status='x'", "key='k'"]
)
def test_a_row_whose_columns_say_another_thing_than_its_result(folder, column):
    with sqlite3.connect(folder / FILE) as database:
        database.execute(f"UPDATE cells SET {column} WHERE seed = 1")
    database.close()
    assert said(verify(folder)) == [
        ("hold-disc/funnel/dqn/1 quick", "row", "its columns do not say what its result says")
    ]
    repair(folder)
    with Ledger(folder / FILE) as ledger:
        assert ledger.finished(keyed(seed).key for seed in range(3)) == {keyed(0).key, keyed(2).key}
        ledger.record(keyed(1))
    assert verify(folder).is_whole
    with Ledger(folder / FILE) as ledger:
        assert [entry.id.seed for entry in ledger.results()] == [0, 1, 2]


def test_the_next_run_measures_exactly_what_was_damaged(tmp_path, scripted):
    cells, again = scripted_cells.cells("a", "b", "c"), scripted_cells.Here()
    run.run_cells(cells, tmp_path, scripted_cells.Here(), run_cell=scripted_cells.run_in)
    with sqlite3.connect(tmp_path / FILE) as database:
        database.execute("UPDATE cells SET result = '{}' WHERE seed = 1")
    database.close()
    repair(tmp_path)
    run.run_cells(cells, tmp_path, again, run_cell=scripted_cells.run_in)
    assert again.ran == [("b", 60)]
    assert verify(tmp_path).is_whole


@pytest.mark.filterwarnings("ignore::stlbench.records.reader.LedgerWarning")
def test_a_ledger_with_a_damaged_structure_is_written_anew_with_all_that_can_be_read(tmp_path):
    entries = [keyed(seed) for seed in range(60)]
    with Ledger(tmp_path / FILE) as ledger:
        ledger.plan({entry.key: entry.id for entry in entries})
        for entry in entries:
            ledger.record(replace(entry, status="killed", measurement=None) if entry.id.seed == 59 else entry)
    database = sqlite3.connect(tmp_path / FILE)
    (size,) = database.execute("PRAGMA page_size").fetchone()
    database.close()
    content = bytearray((tmp_path / FILE).read_bytes())
    pages = (at for at in range(5 * size, len(content), size) if content[at] == 13)  # leaves of a table
    page = next(at for at in pages if b'"status"' in content[at : at + size])
    content[page : page + size] = bytes(size)
    (tmp_path / FILE).write_bytes(content)
    found = repair(tmp_path)
    assert found.structure
    lost = {damage.cell.seed for damage in found.damages}
    assert 0 < len(lost) < 10
    assert (tmp_path / DAMAGED).read_bytes() == content
    assert verify(tmp_path).is_whole
    with Ledger(tmp_path / FILE, create=False) as ledger:
        assert {entry.id.seed for entry in ledger.results()} == set(range(60)) - lost
        assert {cell.seed for cell in ledger.missing()} == lost
        assert len(ledger.given_up([keyed(59).key], 1)) == 1  # what else the rows say has stayed


def test_a_folder_of_lines_and_none_at_all(tmp_path):
    with pytest.raises(UsageError, match="there is no ledger"):
        verify(tmp_path)
    stored.write_lines([keyed(0)], tmp_path / stored.LINES)
    assert (verify(tmp_path).rows, verify(tmp_path).is_whole) == (1, True)
