"""The lines of JSON beside a ledger: what they hold, what a kill leaves of them, and what a stranger puts there."""

from __future__ import annotations

import lzma
import os
import signal
import time
from contextlib import suppress
from dataclasses import replace

import pytest
from helpers.synthetic_results import result

from stlbench.errors import UsageError
from stlbench.records import lines, results_folder
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result_files import LINES, PACKED
from stlbench.records.rows import LedgerWarning
from stlbench.records.upkeep import merge, remove, verify


@pytest.fixture
def folder(tmp_path):
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.plan({f"key {seed}": result(seed=seed).id for seed in range(4)})
        for seed in range(3):
            ledger.record(keyed(seed))
    return tmp_path


def keyed(seed, **changes):
    return replace(result(seed=seed), key=f"key {seed}", **changes)


def seeds(folder):
    return [entry.id.seed for entry in results_folder.read(folder / LINES)]


def test_each_result_is_a_line_as_it_is_recorded(folder):
    assert (
        list(results_folder.read(folder / LINES))
        == list(results_folder.read(folder))
        == [keyed(seed) for seed in range(3)]
    )


def test_of_a_cell_that_stands_twice_the_last_line_counts(folder):
    later = replace(keyed(1), key="edited", status="raised", reason="ValueError: x", measurement=None)
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(later)
    assert list(results_folder.read(folder / LINES)) == [keyed(0), keyed(2), later]


def test_what_was_removed_or_merged_is_so_in_the_lines(folder, tmp_path):
    remove(folder, [keyed(1).id])
    assert seeds(folder) == [0, 2]
    merge(folder / "merged", folder)
    assert seeds(folder / "merged") == [0, 2]
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(keyed(1))
    assert seeds(folder) == [0, 2, 1]


@pytest.mark.parametrize("left", [1, 30, 400])
def test_a_last_line_that_was_cut_is_left_out_and_the_next_takes_its_place(folder, left):
    text = (folder / LINES).read_text()
    (folder / LINES).write_text(text + text[:left])
    (folder / LEDGER).unlink()
    with pytest.warns(LedgerWarning, match=r"cells\.jsonl, line 4: it was cut, as by a kill, and is left out"):
        assert [entry.id.seed for entry in results_folder.read(folder)] == [0, 1, 2]
    lines.append(folder, [keyed(3)])
    assert seeds(folder) == [0, 1, 2, 3]


def test_a_last_line_that_lacks_its_end_alone_counts(folder):
    (folder / LINES).write_text((folder / LINES).read_text().rstrip("\n"))
    assert seeds(folder) == [0, 1, 2]
    lines.append(folder, [keyed(3)])
    assert seeds(folder) == [0, 1, 2, 3]


def test_a_line_that_is_cut_within_the_file_is_refused_and_so_is_another_text(folder):
    text = (folder / LINES).read_text()
    (folder / LINES).write_text(text[:50] + "\n" + text)
    with pytest.raises(UsageError, match="line 1: not a result as"):
        seeds(folder)
    (folder / LINES).write_text(text + "mine")
    with pytest.raises(UsageError, match="line 4: not a result as"):
        seeds(folder)
    lines.append(folder)
    assert (folder / LINES).read_text() == text + "mine\n"


def test_lines_get_what_they_lack_of_the_ledger_when_a_run_begins(folder):
    """As those of an earlier version, or of a file that was deleted; and only the result of a cell that counts."""
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(replace(keyed(2), key="old"))
        ledger.record(keyed(2))
        (folder / LINES).unlink()
        results_folder.take_over(folder, ledger)
        assert sorted(results_folder.read(folder / LINES), key=lambda each: each.id) == [
            keyed(seed) for seed in range(3)
        ]
        size = (folder / LINES).stat().st_size
        results_folder.take_over(folder, ledger)
    assert (folder / LINES).stat().st_size == size


def test_packed_lines_are_read_as_others_and_are_the_same_bytes_at_any_time(folder, monkeypatch):
    planned = results_folder.missing(folder)
    count = lines.write_lines(results_folder.read(folder), folder / PACKED, planned)
    monkeypatch.setattr(time, "time", lambda: 1e9)
    (folder / "later").mkdir()
    lines.write_lines(results_folder.read(folder), folder / "later" / PACKED, planned)
    assert (folder / PACKED).read_bytes() == (folder / "later" / PACKED).read_bytes()
    assert (count, planned) == (4, {"key 3": result(seed=3).id})
    text = lzma.decompress((folder / PACKED).read_bytes()).decode()
    assert text == lines.text_of(results_folder.read(folder), planned)
    assert list(results_folder.read(folder / "later")) == list(results_folder.read(folder))
    assert results_folder.missing(folder / "later") == planned
    with Ledger(folder / "later" / LEDGER) as ledger:
        results_folder.take_over(folder / "later", ledger)
        assert ledger.missing() == [result(seed=3).id]
    assert seeds(folder / "later") == [0, 1, 2]  # from here on the run writes there


@pytest.mark.parametrize("how", ["no bytes", "no rows"])
@pytest.mark.parametrize("name", [LINES, PACKED])
def test_an_empty_ledger_beside_lines_does_not_count(folder, how, name):
    """As a run leaves it that is killed, or finds no space, before it has the lines in its ledger."""
    planned = results_folder.missing(folder)
    lines.write_lines(results_folder.read(folder), folder / name, planned)
    for file in (LEDGER, LINES if name == PACKED else PACKED):
        (folder / file).unlink(missing_ok=True)
    (folder / LEDGER).touch()
    if how == "no rows":
        with Ledger(folder / LEDGER) as ledger:
            ledger.plan({})
    assert results_folder.locate(folder) == folder / name
    results = [keyed(seed) for seed in range(3)]
    assert (list(results_folder.read(folder)), results_folder.missing(folder)) == (results, planned)
    assert verify(folder).rows == 3
    with pytest.raises(UsageError, match=f"no ledger.sqlite with results but {name}; go"):
        results_folder.refuse_lines(folder, "go")
    with Ledger(folder / LEDGER) as ledger:
        results_folder.take_over(folder, ledger)
    assert results_folder.locate(folder) == folder / LEDGER
    assert (list(results_folder.read(folder)), results_folder.missing(folder)) == (results, planned)


def test_a_folder_of_which_all_was_removed_is_still_one_with_a_ledger(folder, tmp_path):
    remove(folder, [keyed(seed).id for seed in range(3)])
    assert results_folder.locate(folder) == folder / LEDGER
    with Ledger(tmp_path / "other" / LEDGER) as ledger:
        ledger.record(keyed(7))
    assert merge(folder, tmp_path / "other").added == 1


@pytest.mark.parametrize("how", ["cut", "noise", "text", "bomb", "twice", "much"])
def test_a_packed_file_that_is_damaged_or_without_end_is_one_line(tmp_path, monkeypatch, how):
    lines.write_lines([keyed(seed) for seed in range(20)], tmp_path / PACKED)
    packed = (tmp_path / PACKED).read_bytes()
    damaged = {
        "cut": packed[:-40],
        "noise": packed[:60] + os.urandom(90) + packed[150:],
        "text": b"{}\n",
        "twice": packed * 2,
    }
    # a file may ask for much memory: here for the last 256 MiB that were unpacked
    damaged["much"] = lzma.compress(b"{}\n", filters=[{"id": lzma.FILTER_LZMA2, "dict_size": 2**28}])
    (tmp_path / PACKED).write_bytes(damaged.get(how, packed))
    monkeypatch.setattr(lines, "_UNPACKED", 1000 if how == "bomb" else 2**33)
    with pytest.raises(UsageError, match="the file would be more than" if how == "bomb" else r"cannot read|line \d+: "):
        list(results_folder.read(tmp_path))


@pytest.mark.parametrize("kind", ["link", "nowhere", "pipe", "folder"])
def test_nothing_is_written_through_a_link_and_no_pipe_is_waited_for(folder, kind):
    secret = folder / "secret"
    secret.write_text("mine")
    (folder / LINES).unlink()
    if kind in ("link", "nowhere"):
        (folder / LINES).symlink_to(secret if kind == "link" else folder / "no-such")
    elif kind == "pipe":
        os.mkfifo(folder / LINES)
    else:
        (folder / LINES).mkdir()
    with Ledger(folder / LEDGER) as ledger:
        for write in (lambda: ledger.record(keyed(5)), lambda: results_folder.take_over(folder, ledger)):
            with pytest.raises(UsageError, match=r"cells\.jsonl"):
                write()
        assert len(list(ledger.results())) == 3
    assert secret.read_text() == "mine"
    assert not (folder / "no-such").exists()


def recording(folder, begin):
    """A process that records cells, from a seed on, and the pipe where it announces each; it is killed later."""
    here, there = os.pipe()
    if (process := os.fork()) == 0:
        with suppress(BaseException), Ledger(folder / LEDGER) as ledger:
            for seed in range(begin, 10_000):
                ledger.record(result(seed=seed))
                os.write(there, f"{seed}\n".encode())
        os._exit(1)
    os.close(there)
    return process, os.fdopen(here)


@pytest.mark.filterwarnings("ignore::stlbench.records.rows.LedgerWarning")
def test_whenever_a_run_is_killed_what_was_announced_is_in_ledger_and_lines(tmp_path):
    announced = list[int]()
    for kill in range(12):
        process, pipe = recording(tmp_path, len(announced))
        with pipe:
            announced += [int(pipe.readline()) for _ in range(5)]
            time.sleep(0.0007 * kill)
            os.kill(process, signal.SIGKILL)
            announced += map(int, pipe.read().split())
        assert os.waitpid(process, 0)[1] == signal.SIGKILL
    with Ledger(tmp_path / LEDGER, create=False) as ledger:
        recorded = {entry.id.seed for entry in ledger.results()}
    assert set(announced) <= recorded <= set(seeds(tmp_path))
    (tmp_path / LEDGER).unlink()
    with Ledger(tmp_path / LEDGER) as ledger:
        results_folder.take_over(tmp_path, ledger)
        assert {entry.id.seed for entry in ledger.results()} == set(seeds(tmp_path))
