"""Cells taken out of a folder of results, and folders put together."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import synthetic_results

from stlbench.errors import UsageError
from stlbench.records import array_files, results_folder
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.lines import write_lines
from stlbench.records.result import Result, StoredPolicies
from stlbench.records.result_files import LINES, cell_files
from stlbench.records.upkeep import Merged, choose, merge, remove, repair, verify
from stlbench.report import condense
from stlbench.study.results import Results

MORNING, EVENING = "2026-11-22T08:00:00+00:00", "2026-11-22T20:00:00+00:00"


def result(*which, **more) -> Result:
    """A synthetic result, with a key that can be part of a file's name."""
    made = synthetic_results.result(*which, **more)
    return replace(made, key=hashlib.sha256(made.key.encode()).hexdigest())


def folder_of(path: Path, *results: Result) -> Path:
    """A ledger, and files of traces and of policies for each of the results; their content is the folder's name."""
    with Ledger(path / LEDGER) as ledger:
        for one in results:
            for file in (cell_files(path, one.id, one.key).traces, cell_files(path, one.id, one.key).policies):
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(path.name)
            ledger.record(one)
    return path


def at(time: str, one: Result, key: str | None = None) -> Result:
    return replace(one, provenance={"time": time}, key=key or one.key)


def counts(added=0, replaced=0, kept=0, planned=0, conflicts=(), damaged=(), other_code=0):
    return Merged(added, replaced, kept, planned, conflicts, damaged, other_code)


@pytest.fixture
def folder(tmp_path):
    return folder_of(
        tmp_path / "results",
        result("funnel", 0),
        result("funnel[ginf=0.02]", 0),
        result("funnel", 1, "raised"),
        result("flag", 0, "timeout", task="overlap"),
        result("flag", 0, task="overlap", budget="smoke"),
    )


@pytest.mark.parametrize(
    ("said", "count"),
    [
        ({"names": ["hold-disc/funnel/dqn/0"]}, 1),
        ({"names": ["hold-disc/funnel[ginf=0.02]/dqn/0"]}, 1),
        ({"names": ["hold-disc/*"]}, 3),
        ({"names": ["*/funnel/*", "overlap/*"]}, 4),
        ({"statuses": ["raised", "timeout"]}, 2),
        ({"names": ["hold-disc/*"], "statuses": ["raised", "timeout"]}, 1),
        ({"budget": "smoke"}, 1),
        ({"names": ["overlap/flag/dqn/0"], "budget": "quick"}, 1),
    ],
)
def test_choosing(folder, said, count):
    assert len(choose(folder, **said)) == count


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ({}, "which cells"),
        ({"names": ["hold-disc/funnel/dqn/9"]}, "no cell 'hold-disc/funnel/dqn/9'; did you mean"),
        ({"names": ["pendulum/*"]}, r"no cell 'pendulum/\*'"),
        ({"statuses": ["rased"]}, "no status 'rased'; did you mean 'raised'"),
        ({"statuses": ["killed"]}, "no such cell in"),
    ],
)
def test_choosing_nothing(folder, said, message):
    with pytest.raises(UsageError, match=message):
        choose(folder, **said)


def test_what_is_removed_is_gone_with_its_files_and_older_results(folder):
    cell = result("funnel", 0).id
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(replace(result("funnel", 0), key="of an older plugin"))
        ledger.plan({"planned": cell})
    assert [len(list((folder / kind).iterdir())) for kind in ("traces", "policies")] == [5, 5]
    remove(folder, [cell])
    loaded = Results.load(folder)
    assert "hold-disc/funnel/dqn/0" not in [one.id.name for one in loaded]
    assert (len(loaded), loaded.missing) == (4, (cell,))  # another seed is there
    assert [len(list((folder / kind).iterdir())) for kind in ("traces", "policies")] == [4, 4]


def test_a_seed_that_was_removed_is_missing_beside_the_others(folder):
    cells = [result("funnel", seed).id for seed in range(2)]
    remove(folder, cells[:1])
    (group,) = (each for each in condense(*seen(folder)) if each.setting == cells[0].setting)
    assert group.seeds == (0, 2, "1 not run, 1 raised")
    remove(folder, cells[1:])
    assert cells[0].setting not in [each.setting for each in condense(*seen(folder))]


def seen(folder):
    results = Results.load(folder)
    return results.results, results.missing


def test_a_setting_that_was_planned_and_never_measured_can_be_removed(folder):
    planned = [result("funnel", seed, budget="paper").id for seed in range(2)]
    with Ledger(folder / LEDGER) as ledger:
        ledger.plan({f"key {cell.seed}": cell for cell in planned})
        ledger.plan_also({"beside others": result("funnel", 2).id})
    expected = dict.fromkeys(planned, "not run")
    assert choose(folder, budget="paper") == choose(folder, statuses=["not run"]) == expected
    assert choose(folder, names=["*/funnel/*"], statuses=["not run"]) == expected
    remove(folder, planned[:1])
    assert choose(folder, budget="paper") == {planned[1]: "not run"}
    remove(folder, planned[1:])
    assert Results.load(folder).missing == (result("funnel", 2).id,)
    with pytest.raises(UsageError, match="no such cell"):
        choose(folder, budget="paper")
    assert len(Results.load(folder)) == 5


def test_a_policy_from_outside_that_was_removed_is_gone(tmp_path):
    """No run measures it again."""
    both = [result("funnel", seed, track="outside") for seed in range(2)]
    folder = folder_of(tmp_path, *both)
    remove(folder, [both[0].id])
    assert Results.load(folder).missing == ()


def test_merging_counts_and_the_newest_wins(tmp_path):
    a, b, c = (result("funnel", seed) for seed in range(3))
    into = folder_of(tmp_path / "into", at(MORNING, a), at(EVENING, b), at(MORNING, result("flag")))
    source = folder_of(tmp_path / "source", at(EVENING, a, "newer"), at(MORNING, b), at(MORNING, c))
    assert merge(into, source) == counts(added=1, replaced=1, kept=1, other_code=1)
    merged = {one.id.name: one for one in Results.load(into)}
    assert len(merged) == 4
    assert merged[a.id.name].key == "newer"
    assert merged[b.id.name].provenance["time"] == EVENING
    assert [path.read_text() for path in cell_files(into, a.id, "newer")[:2]] == ["source"] * 2
    assert [path.read_text() for path in cell_files(into, b.id, b.key)[:2]] == ["into"] * 2
    assert not any(path.exists() for path in cell_files(into, a.id, a.key))
    assert merge(into, source) == counts(kept=3)
    assert len(Results.load(source)) == 3


def test_merging_into_a_new_folder_from_lines(tmp_path):
    write_lines([result("funnel"), result("flag", 1, "raised")], tmp_path / "text" / LINES)
    assert merge(tmp_path / "new", tmp_path / "text") == counts(added=2)
    assert Results.load(tmp_path / "new").results == Results.load(tmp_path / "text").results


def test_folders_that_cannot_be_merged(folder, tmp_path):
    with pytest.raises(UsageError, match="cannot be merged into itself"):
        merge(folder, folder)
    with pytest.raises(UsageError, match="there is neither"):
        merge(folder, tmp_path / "nowhere")
    write_lines([result("funnel")], tmp_path / "text" / LINES)
    with pytest.raises(UsageError, match="merge into a new folder, and export that"):
        merge(tmp_path / "text", folder)


def test_a_failure_gives_way_to_a_result_whenever_either_was_measured(tmp_path):
    done, failed = result("funnel", 0), result("funnel", 0, "killed")
    into = folder_of(tmp_path / "into", at(EVENING, failed), at(MORNING, result("funnel", 1)))
    source = folder_of(tmp_path / "source", at(MORNING, done), at(EVENING, result("funnel", 1, "timeout")))
    assert merge(into, source) == counts(replaced=1, kept=1)
    assert [one.status for one in Results.load(into)] == ["done", "done"]
    assert merge(source, into) == counts(replaced=1, kept=1)
    assert Results.load(source).results == Results.load(into).results


def test_other_scores_under_the_same_key_are_named_but_not_of_an_edited_plugin(tmp_path):
    a, b, c = (result("funnel", seed) for seed in range(3))
    other = replace(result("funnel", 0, robustness=(0.1, 0.2)), key=a.key)
    slower = replace(result("funnel", 1, training_cpu_seconds=99.0), key=b.key)
    edited = replace(result("funnel", 2, robustness=(0.1, 0.2)), key="f" * 64)
    into = folder_of(tmp_path / "into", at(MORNING, a), at(MORNING, b), at(MORNING, c))
    source = folder_of(tmp_path / "source", at(EVENING, other), at(EVENING, slower), at(EVENING, edited))
    assert merge(into, source) == counts(replaced=3, conflicts=("hold-disc/funnel/dqn/0",), other_code=1)


def test_what_the_source_has_planned_and_lacks_is_planned_here_too(tmp_path):
    a, b, c = (result("funnel", seed) for seed in range(3))
    into, source = folder_of(tmp_path / "into", a), folder_of(tmp_path / "source", b)
    with Ledger(source / LEDGER) as ledger:
        ledger.plan({one.key: one.id for one in (a, b, c)})
    assert merge(into, source) == counts(added=1, planned=1)
    assert Results.load(into).missing == (c.id,)
    assert merge(into, source) == counts(kept=1)
    text = tmp_path / "text"
    write_lines(results_folder.read(source), text / LINES, results_folder.missing(source))
    assert merge(tmp_path / "other", text) == counts(added=1, planned=2)
    assert Results.load(tmp_path / "other").missing == (a.id, c.id)


def test_a_damaged_file_is_not_copied_and_named(tmp_path):
    a = result("funnel", 0)
    source = folder_of(tmp_path / "source", a)
    file = cell_files(source, a.id, a.key).traces
    file.write_text("not as it was recorded")
    assert merge(tmp_path / "into", source) == counts(added=1, damaged=(str(file),))
    assert not cell_files(tmp_path / "into", a.id, a.key).traces.exists()
    assert cell_files(tmp_path / "into", a.id, a.key).policies.exists()


def test_results_one_by_one_are_the_same_as_all_at_once(tmp_path):
    entries = [result(seed=seed) for seed in range(3)]
    with Ledger(tmp_path / LEDGER) as ledger:
        for entry in entries:
            ledger.record(entry)
    write_lines(entries, tmp_path / "other" / LINES)
    for folder in (tmp_path, tmp_path / "other"):
        with results_folder.one_by_one(folder) as find:
            assert [find(entry.id) for entry in entries] == list(results_folder.read(folder))
            assert find(result(seed=7).id) is None


def test_a_damaged_result_takes_the_place_of_no_sound_one(tmp_path):
    a = result("funnel", 0)
    for key in (a.key, "f" * 64):
        into = folder_of(tmp_path / key / "into", at(MORNING, a))
        source = folder_of(tmp_path / key / "source", at(EVENING, a, key))
        file = cell_files(source, a.id, key).policies
        file.write_text("not as it was recorded")
        assert merge(into, source) == counts(kept=1, damaged=(str(file),), other_code=key != a.key)
        assert [path.read_text() for path in cell_files(into, a.id, a.key)[:2]] == ["into"] * 2
        assert verify(into).is_whole
    failed = folder_of(tmp_path / "failed", at(EVENING, result("funnel", 0, "killed")))
    assert merge(failed, source) == counts(replaced=1, damaged=(str(file),), other_code=1)


def test_a_sound_result_takes_the_place_of_a_damaged_one(tmp_path):
    """Though it is older: so files that were lost come back by a merge."""
    a = result("funnel", 0)
    into, source = folder_of(tmp_path / "into", at(EVENING, a)), folder_of(tmp_path / "source", at(MORNING, a))
    cell_files(into, a.id, a.key).policies.unlink()
    assert merge(into, source) == counts(replaced=1)
    assert [path.read_text() for path in cell_files(into, a.id, a.key)[:2]] == ["source"] * 2
    assert verify(into).is_whole


def test_deleted_traces_are_no_damage_to_a_merge(tmp_path):
    """They may be deleted to save space. The later result stays on both sides, and text alone mends nothing."""
    a = result("funnel", 0)
    into, source = folder_of(tmp_path / "into", at(EVENING, a)), folder_of(tmp_path / "source", at(MORNING, a))
    cell_files(into, a.id, a.key).traces.unlink()
    assert merge(into, source) == counts(kept=1)
    text = tmp_path / "text"
    write_lines(results_folder.read(source), text / LINES)
    assert merge(into, text) == counts(kept=1)
    assert cell_files(into, a.id, a.key).policies.read_text() == "into"
    assert merge(source, into) == counts(replaced=1)


def test_a_log_of_a_failure_goes_with_it(tmp_path):
    a = result("funnel", 0)
    into = folder_of(tmp_path / "into", at(MORNING, replace(result("funnel", 0, "killed"), key=a.key)))
    source = folder_of(tmp_path / "source", at(EVENING, a))
    log = cell_files(into, a.id, a.key).log
    log.parent.mkdir(exist_ok=True)
    log.write_text("Killed")
    assert merge(into, source) == counts(replaced=1)
    assert not log.exists()


def test_where_files_cannot_be_copied_no_result_is_lost(tmp_path):
    a = result("funnel", 0)
    into, source = folder_of(tmp_path / "into", at(MORNING, a)), folder_of(tmp_path / "source", at(EVENING, a, "newer"))
    (into / "policies").rename(tmp_path / "aside")
    (into / "policies").symlink_to(tmp_path / "aside")
    with pytest.raises(UsageError, match="is a link"):
        merge(into, source)
    assert [one.key for one in Results.load(into)] == [a.key]


def test_where_the_ledger_cannot_be_written_the_result_of_before_stays(tmp_path, monkeypatch):
    a = result("funnel", 0)
    into, source = folder_of(tmp_path / "into", at(MORNING, a)), folder_of(tmp_path / "source", at(EVENING, a, "newer"))

    def full(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("stlbench.records.ledger._insert", full)
    with pytest.raises(KeyboardInterrupt):
        merge(into, source)
    assert [one.key for one in Results.load(into)] == [a.key]
    assert [path.read_text() for path in cell_files(into, a.id, a.key)[:2]] == ["into"] * 2


def test_what_takes_the_place_of_a_result_is_the_last_line_of_its_cell(tmp_path):
    a = result("funnel", 0)
    into, source = folder_of(tmp_path / "into", at(MORNING, a)), folder_of(tmp_path / "source", at(EVENING, a, "newer"))
    merge(into, source)
    assert [one.key for one in Results.load(into / LINES)] == ["newer"]
    assert verify(into).is_whole


def test_a_file_is_no_folder_to_merge_into_and_one_with_results_is_a_source(folder, tmp_path):
    (tmp_path / "a.py").touch()
    with pytest.raises(UsageError, match=r"a\.py is a file; name a folder of results"):
        merge(tmp_path / "a.py", folder)
    for number, source in enumerate((folder / LEDGER, folder / LINES)):
        assert merge(tmp_path / f"new-{number}", source) == counts(added=5)
        assert verify(tmp_path / f"new-{number}").is_whole


def with_policies(path: Path, one: Result) -> tuple[Path, Result]:
    """A folder with a result that has the hashes of its policies, and their file."""
    arrays = {"selected": {"a": np.arange(99.0)}, "final": {"a": np.ones(9)}}
    stored = StoredPolicies(*map(array_files.digest, arrays.values()), 4)
    one = replace(one, measurement=replace(one.measured, policies=stored))
    array_files.write_arrays(
        cell_files(path, one.id, one.key).policies,
        {f"{which}/{name}": array for which, named in arrays.items() for name, array in named.items()},
    )
    with Ledger(path / LEDGER) as ledger:
        ledger.record(one)
    return path, one


def overwritten(path: Path, at: int) -> None:
    content = bytearray(path.read_bytes())
    content[at] ^= 0xFF
    path.write_bytes(content)


def test_policies_that_were_damaged_on_the_way_stay_damaged_and_come_back(tmp_path):
    """Also where the checksums of the ledger were taken of what lay there."""
    sound, one = with_policies(tmp_path / "sound", result("funnel", 0))
    damaged, _ = with_policies(tmp_path / "damaged", result("funnel", 0))
    file = cell_files(damaged, one.id, one.key).policies
    overwritten(file, 90)
    assert merge(tmp_path / "into", damaged) == counts(added=1, damaged=(str(file),))
    (damage,) = verify(tmp_path / "into").damages
    assert (damage.cell, damage.what, "has no policy at" in damage.problem) == (one.id, "policies", True)
    assert verify(tmp_path / "into").files == 0
    assert merge(tmp_path / "into", sound) == counts(replaced=1)
    assert (verify(tmp_path / "into").files, verify(tmp_path / "into").is_whole) == (1, True)
    (damaged / LEDGER).unlink()
    with Ledger(damaged / LEDGER) as ledger:
        results_folder.take_over(damaged, ledger)
    assert [damage.what for damage in verify(damaged).damages] == ["policies"]
    assert merge(damaged, sound) == counts(replaced=1)
    assert verify(damaged).is_whole


def test_a_cell_that_is_to_run_again_is_so_after_a_merge(tmp_path):
    a, b, c = (result("funnel", seed) for seed in range(3))
    source = folder_of(tmp_path / "source", *(at(EVENING, one) for one in (a, b, c)))
    for one in (a, b):
        cell_files(source, one.id, one.key).traces.unlink()
    repair(source)
    into = folder_of(tmp_path / "into", at(MORNING, a))
    assert merge(into, source) == counts(added=2, replaced=1)
    with Ledger(into / LEDGER) as ledger:
        assert ledger.finished(one.key for one in (a, b, c)) == {c.key}
    assert merge(into, folder_of(tmp_path / "sound", at("2026-11-23", a))) == counts(replaced=1)
    with Ledger(into / LEDGER) as ledger:
        assert ledger.finished(one.key for one in (a, b, c)) == {a.key, c.key}


def test_a_result_whose_key_was_planned_stays_though_older_code_ran_later(tmp_path):
    a = at(MORNING, result("funnel", 0))
    into = folder_of(tmp_path / "into", a)
    with Ledger(into / LEDGER) as ledger:
        ledger.plan({a.key: a.id})
    old = folder_of(tmp_path / "old", at(EVENING, a, "older"))
    assert merge(into, old) == counts(kept=1, other_code=1)
    assert merge(into, folder_of(tmp_path / "again", at(EVENING, a))) == counts(replaced=1)
    assert merge(into, folder_of(tmp_path / "later", at("2026-11-23", a, "older"))) == counts(kept=1, other_code=1)
    assert [one.key for one in Results.load(into)] == [a.key]
    assert merge(old, into) == counts(kept=1, other_code=1)  # it has no plan, and its own began as late
    with Ledger(old / LEDGER) as ledger:
        ledger.plan({a.key: a.id})
    assert merge(old, into) == counts(replaced=1, other_code=1)
