"""`stlbench report` of bundles, on made-up plugins."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from cli.conftest import TOY
from helpers.bundles import changed
from helpers.pages import Page
from helpers.refusals import refused

from stlbench.records.ledger import LEDGER, Ledger


@pytest.fixture
def bundles(once) -> None:
    for name, seeds in (("mine", "0-1"), ("theirs", "2-3")):
        once(*TOY, "--methods", "toy-raw", "--seeds", seeds, "--results", name)
        once("bundle", name, f"{name}.zip", "--author", "Ada Lovelace")


def test_bundles_stand_in_one_table_and_are_scored_again_where_asked(say, bundles) -> None:
    done = say("report", "theirs.zip", "mine.zip", "--rescore", "--json")
    said = json.loads(done.stdout)
    assert done.exit_code == 0
    assert done.stderr.splitlines() == [f"toy-line/toy-raw/toy-agent/{seed}: as recorded" for seed in range(4)]
    assert [(row["bundle"], row["by"], row["policies"]) for row in said["bundles"]] == [
        (name, "Ada Lovelace", "as recorded") for name in ("mine", "theirs")
    ]
    methods = ["toy-raw[bundle=mine]", "toy-raw[bundle=theirs]"]
    assert [(row["method"], row["seeds done"]) for row in said["robustness"]] == [(method, 2) for method in methods]
    (pair,) = said["comparisons"]
    assert [pair["method"], pair["other"]] == methods


def test_a_damaged_bundle_is_left_out_and_a_failure(say, bundles) -> None:
    changed(Path("mine.zip"), Path("changed.zip"), {"cells.jsonl": b"{}"})
    done = say("report", "changed.zip", "mine.zip")
    assert done.exit_code == 1
    assert "changed.zip is refused: cells.jsonl: 2 bytes, and" in " ".join(done.stdout.split())
    assert "bundle=mine" in done.stdout


def test_bundles_have_a_page(say, bundles) -> None:
    assert say("report", "mine.zip", "theirs.zip", "--html").stdout.endswith(" MB, 4 cells\n")
    page = Page(Path("report.html").read_text())
    assert len(page.cells) == 4
    assert "Ada Lovelace" in page.text


PLANNED = {"maximised": "reward", "value": 0.9}


@pytest.mark.parametrize("changes", [None, {"policies": None}, {"policies": None, "planned": PLANNED}])
def test_a_claimed_score_without_its_policy_is_in_no_table(say, bundles, changes) -> None:
    """The policy of one cell was taken away; its record may say that there is none, or that it was planned."""
    lines = Path("theirs/cells.jsonl")
    first, *others = map(json.loads, lines.read_text().splitlines())
    for scores in (first["measurement"][which] for which in ("selected", "final")):
        scores["formula"] |= {"robustness": [0.9] * 8, "satisfied": [True] * 8, "first_failed": {}}
    first["measurement"] |= changes or {}
    lines.write_text("".join(f"{json.dumps(line)}\n" for line in (first, *others)))
    Path("theirs", LEDGER).unlink()
    next(path for path in Path("theirs/policies").iterdir() if first["key"].startswith(path.stem[-12:])).unlink()
    say("bundle", "theirs", "theirs.zip")
    name = f"toy-line/toy-raw/toy-agent/{first['seed']}"
    why = f"{name} has no {'stored policy: its agent stores none, by the record' if changes else 'policy at policies/'}"
    checked = say("verify", "theirs.zip", "--rescore")
    assert checked.exit_code == 3
    assert f"[1/2] {name}: not scored, {why}" in checked.stderr
    done = say("report", "mine.zip", "theirs.zip", "--rescore", "--json")
    assert done.exit_code == 3
    assert f"\n{name}: not scored, {why}" in done.stderr
    said = json.loads(done.stdout)
    assert [(row["cells"], row["policies"]) for row in said["bundles"]] == [(2, "as recorded"), (2, "not scored")]
    (cell,) = (row for row in said["cells"] if row["status"] == "not scored")
    assert (cell["seed"], cell["method"]) == (first["seed"], "toy-raw[bundle=theirs]")
    assert (cell["robustness_mean"], cell["final_robustness_mean"]) == (None, None)
    assert cell["reason"].startswith(why)
    assert said["robustness"][1]["seeds unfinished"] == "1 not scored"
    assert "0.9" not in json.dumps([said["robustness"], said["comparisons"]])
    assert say("report", "mine.zip", "theirs.zip", "--rescore", "--html").exit_code == 3
    assert "not scored" in Page(Path("report.html").read_text()).text
    changed(Path("mine.zip"), Path("changed.zip"), {"cells.jsonl": b"{}"})
    assert say("report", "changed.zip", "theirs.zip", "--rescore").exit_code == 1


def test_a_bundle_of_which_nothing_is_scored_is_reported(say, bundles) -> None:
    for path in Path("mine/policies").iterdir():
        path.unlink()
    say("bundle", "mine", "mine.zip")
    for words in ((), ("--json",), ("--html",), ("--explain",)):
        assert say("report", "mine.zip", "--rescore", *words).exit_code == 3
    assert "2 not scored" in say("report", "mine.zip", "--rescore").stdout
    assert say("report", "mine.zip").exit_code == 0


def test_cells_that_were_planned_and_never_ran_are_not_hidden(say, bundles) -> None:
    with Ledger(Path("mine") / LEDGER) as ledger:
        planned = [replace(result.id, seed=seed) for result in ledger.results() for seed in (5, 6)]
        ledger.plan({f"{cell.seed:032}": cell for cell in planned})
    say("bundle", "mine", "mine.zip")
    of_folder, of_bundles = (
        json.loads(say("report", *paths, "--json").stdout)["robustness"]
        for paths in (["mine"], ["mine.zip", "theirs.zip"])
    )
    told = [("seeds done", 2), ("seeds planned", 4), ("seeds unfinished", "2 not run")]
    assert [[(name, row[name]) for name, _ in told] for row in (*of_folder, of_bundles[0])] == [told, told]
    assert [row["method"] for row in of_bundles] == ["toy-raw[bundle=mine]", "toy-raw[bundle=theirs]"]
    assert say("report", "mine.zip", "--html").stdout.endswith(" MB, 2 cells\n")
    page = Page(Path("report.html").read_text())
    assert len(page.cells) == 4


@pytest.mark.parametrize("words", [("no.zip",), ("one", "two")])
def test_bad_input_is_one_line(say, words) -> None:
    refused(say("report", *words))
