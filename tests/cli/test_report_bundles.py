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
