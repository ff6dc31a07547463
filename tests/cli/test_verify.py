"""`stlbench bundle`, `verify`, and `compare` of bundles: what they say, and their exit codes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import pytest
from helpers import ledgers
from helpers.bundles import changed
from helpers.refusals import refused
from helpers.synthetic_results import result
from typer.testing import CliRunner

from stlbench.cli import app
from stlbench.errors import DiskFull
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result_files import LINES
from stlbench.share.bundle import check


@pytest.fixture
def folder(tmp_path):
    with Ledger(tmp_path / LEDGER) as ledger:
        for seed in range(3):
            ledger.record(result(seed=seed))
    return tmp_path


def say(*words):
    return CliRunner().invoke(app, ["verify", *map(str, words)])


def damage(folder):
    ledgers.say(folder / LEDGER, "UPDATE cells SET result = '{}' WHERE seed = 1")


def test_damage_is_named_and_repaired(folder):
    done = say(folder)
    assert (done.exit_code, done.stdout) == (0, f"{folder}/: 3 rows, 0 files as they were recorded: whole\n")
    damage(folder)
    done = say(folder)
    assert done.exit_code == 1
    assert done.stdout.splitlines() == [
        "hold-disc/funnel/dqn/1 quick: row: it does not have the checksum that was recorded with it",
        f"{folder}/: 3 rows, 0 files as they were recorded: 1 with damage",
        "--repair marks the cells, and the `stlbench run` that measured them measures them again",
    ]
    found = json.loads(say(folder, "--json").stdout)
    assert (found["whole"], found["rows"], found["repaired"]) == (False, 3, False)
    assert [(one["cell"], one["what"]) for one in found["damages"]] == [("hold-disc/funnel/dqn/1 quick", "row")]
    done = say(folder, "--repair")
    assert done.exit_code == 0
    assert "repaired: the `stlbench run` that measured them measures them again" in done.stdout
    assert "1 cell is marked, for the next `stlbench run` to measure again" in say(folder).stdout


def test_a_ledger_that_sqlite_cannot_read_is_one_line_with_the_ways_out(folder):
    file = folder / LEDGER
    file.write_bytes(file.read_bytes()[:4096] + bytes(4096) + file.read_bytes()[8192:])
    done = say(folder)
    assert (done.exit_code, done.stdout.count("\n")) == (1, 1)
    assert done.stdout.startswith(f"{file} is damaged: ")
    ways = "; take the file away, and the results are read from cells.jsonl beside it; or SQLite's own tool writes anew"
    assert f"{ways} what it can read: `sqlite3 {file} .recover | sqlite3 {folder / 'new-ledger.sqlite'}`" in done.stdout
    for command in (["report", folder], ["verify", folder, "--repair"], ["export", folder]):
        assert ways in refused(CliRunner().invoke(app, list(map(str, command))))
    file.unlink()
    assert say(folder).stdout == f"{folder}/: 3 rows, 0 files as they were recorded: whole\n"


def test_a_damaged_line_is_named_and_written_anew(folder):
    file = folder / LINES
    file.write_text(file.read_text().replace('"status": "done"', '"status": "d', 1))
    done = say(folder)
    assert (done.exit_code, done.stdout.count("\n")) == (1, 3)
    assert done.stdout.startswith(f"{file}, line 1: not a result as")
    assert "3 rows, 0 files as they were recorded: cells.jsonl is damaged\n--repair writes cells.jsonl" in done.stdout
    assert say(folder, "--repair").exit_code == 0
    assert say(folder).stdout == f"{folder}/: 3 rows, 0 files as they were recorded: whole\n"


def test_a_ledger_without_rows_is_empty(tmp_path):
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.plan({"a": result().id})
    done = say(tmp_path)
    assert (done.exit_code, done.stdout) == (0, f"{tmp_path}/: 0 rows, 0 files as they were recorded: empty\n")


def test_one_row_and_one_file_without_a_result_are_one(tmp_path):
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.record(result())
    (tmp_path / "traces").mkdir()
    (tmp_path / "traces" / "lost_0123456789ab.npz").touch()
    said = f"{tmp_path}/: 1 row, 0 files as they were recorded: 1 file without a result"
    assert said in say(tmp_path).stdout.splitlines()


def test_a_full_disk_has_a_code_of_its_own(folder, monkeypatch):
    def full(place):
        raise DiskFull("cannot write")

    monkeypatch.setattr("stlbench.records.upkeep.repair", full)
    done = say(folder, "--repair")
    assert (done.exit_code, done.stderr) == (74, "error: cannot write\n")


def test_a_bundle_of_a_run_is_fine(say, ran) -> None:
    done = say("bundle", "results", "--author", "Ada Lovelace")
    assert done.exit_code == 0
    assert done.stdout.startswith("Written to results.zip: 2 cells, policies of 2, ")
    assert done.stdout.endswith(" MB; licence CC-BY-4.0\n")
    assert check(Path("results.zip")) == (2, 2, ())


@pytest.mark.parametrize(
    ("folder", "name"),
    [("mÿ résultats €", "my-resultats.zip"), ("a  b+c_1.2", "a-b+c_1.2.zip"), ("結果", "results.zip")],
)
def test_a_bundle_has_a_name_that_a_report_takes(say, ran, folder, name) -> None:
    Path("results").rename(folder)
    assert say("bundle", folder).stdout.startswith(f"Written to {name}: 2 cells, ")
    assert say("report", name).exit_code == 0
    said = refused(say("bundle", folder, f"to/{folder} €.zip"))
    assert "its name ends in .zip, after letters, digits and . _ + -; got to/" in said
    assert not Path("to").exists()


@pytest.mark.parametrize("option", ["--author", "--license"])
def test_a_bundle_has_no_empty_author_or_licence(say, ran, option) -> None:
    for text in ("", " "):
        assert refused(say("bundle", "results", option, text)).startswith("error: --author and --license need a text")
    assert not Path("results.zip").exists()


def test_compare_reads_bundles(say, ran) -> None:
    say("bundle", "results", "one.zip")
    done = say("compare", "one.zip", "results")
    assert (done.exit_code, done.stdout.splitlines()[0]) == (0, "# stlbench compare: no worse")
    Path("two.zip").write_bytes(b"PK")
    assert refused(say("compare", "one.zip", "two.zip")).startswith("error: two.zip is no bundle")


def test_verify_scores_a_bundle_again(say, ran) -> None:
    say("bundle", "results", "mine.zip")
    done = say("verify", "mine.zip", "--rescore")
    assert done.exit_code == 0
    assert done.stdout.startswith("mine.zip: 2 cells, policies of 2: every file as it was packed\n")
    assert done.stdout.count("as recorded") == 2
    assert done.stderr.splitlines()[0] == "[1/2] toy-line/toy-raw/toy-agent/0: as recorded"
    said = json.loads(say("verify", "mine.zip", "--rescore", "--json").stdout)
    assert (said["whole"], [each["verdict"] for each in said["rescored"]]) == (True, ["as recorded"] * 2)
    assert said["rescored"][0]["recorded"] == said["rescored"][0]["found"]
    assert said["rescored"][0]["found"]["formula"]["satisfaction"] <= 1


@pytest.mark.parametrize("kind", ["the plugin", "the policies", "one policy"])
def test_a_bundle_of_which_a_policy_cannot_be_scored_is_not_confirmed(say, ran, kind) -> None:
    for path in sorted(Path("results/policies").iterdir())[kind == "one policy" :] if kind != "the plugin" else ():
        path.unlink()
    if kind == "the plugin":
        replace_text(Path("results/cells.jsonl"), "toy-line", "no-line")
    say("bundle", "results", "mine.zip")
    done = say("verify", "mine.zip", "--rescore")
    assert done.exit_code == 3, done.output
    count = 1 if kind == "one policy" else 2
    assert f"{count} of 2 policies could not be scored here: the bundle is not confirmed" in done.stdout.splitlines()
    assert [line.partition(" ")[0] for line in done.stderr.splitlines()] == ["[1/2]", "[2/2]"]
    assert "stlbench-" not in done.output  # the temporary folder
    said = json.loads(say("verify", "mine.zip", "--rescore", "--json").stdout)
    assert [each["verdict"] for each in said["rescored"]].count("not scored") == count


def replace_text(lines: Path, old: str, new: str) -> None:
    lines.write_text(lines.read_text().replace(old, new))
    for path in Path("results/policies").iterdir():
        path.rename(path.with_name(path.name.replace(old, new)))
    Path("results", LEDGER).unlink()


def test_nor_is_one_without_policies(tmp_path) -> None:
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.record(replace(result(), key="0" * 32))
    CliRunner().invoke(app, ["bundle", str(tmp_path), str(tmp_path / "mine.zip")])
    done = say(tmp_path / "mine.zip", "--rescore")
    assert done.exit_code == 3
    assert done.stdout.splitlines()[-1] == "1 of 1 policies could not be scored here: the bundle is not confirmed"
    name = "hold-disc/funnel/dqn/0"
    why = f"{name} has no stored policy: its agent stores none, by the record"
    assert done.stderr == f"[1/1] {name}: not scored, {why}\n"
    assert say(tmp_path / "mine.zip").exit_code == 0


def test_nor_is_one_in_which_no_cell_finished(tmp_path) -> None:
    with Ledger(tmp_path / LEDGER) as ledger:
        ledger.record(replace(result(status="timeout", reason="late"), key="0" * 32))
    CliRunner().invoke(app, ["bundle", str(tmp_path), str(tmp_path / "mine.zip")])
    done = say(tmp_path / "mine.zip", "--rescore")
    assert done.exit_code == 3
    assert done.stdout.splitlines()[-1] == "no cell has a policy to score: the bundle is not confirmed"


def test_verify_names_what_is_wrong_with_a_bundle(say, ran) -> None:
    """Of one whose results were changed it says no more than that."""
    say("bundle", "results", "mine.zip")
    changed(Path("mine.zip"), Path("other.zip"), {"report.md": b"better"})
    done = say("verify", "other.zip", "--rescore")
    assert done.exit_code == 1
    assert done.stdout.startswith("report.md: 6 bytes, and ro-crate-metadata.json says ")
    assert done.stdout.endswith("other.zip: 2 cells, policies of 2: not what it says\n")
    with ZipFile("mine.zip") as archive:
        lines = archive.read("cells.jsonl")
    changed(Path("mine.zip"), Path("other.zip"), {"cells.jsonl": lines.replace(b"0", b"1", 1)})
    done = say("verify", "other.zip")
    ending = "other.zip: its results were not read: not what it says"
    assert done.exit_code == 1
    assert done.stdout.splitlines() == ["cells.jsonl: its content is another than when it was packed", ending]


def test_options_that_do_not_fit_are_one_line(say, ran) -> None:
    say("bundle", "results", "mine.zip")
    for words in (("mine.zip", "--repair"), ("results", "--rescore"), ("no.zip",)):
        refused(say("verify", *words))
