"""`stlbench bundle`, and `compare` of bundles, on made-up plugins."""

from __future__ import annotations

import json
from pathlib import Path
from zipfile import ZipFile

import pytest
from helpers.bundles import changed
from helpers.refusals import refused

from stlbench.share.checked import check

RUN = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--executor", "toy-here", "--methods", "toy-raw")


@pytest.fixture
def recorded(say, toy):
    assert say(*RUN).exit_code == 0


def test_a_bundle_of_a_run_is_fine(say, recorded) -> None:
    done = say("bundle", "results", "--author", "Ada Lovelace")
    assert done.exit_code == 0
    assert done.stdout.startswith("Written to results.zip: 2 cells, policies of 2, ")
    assert done.stdout.endswith(" MB; licence CC-BY-4.0\n")
    assert check(Path("results.zip")) == (2, 2, ())


def test_compare_reads_bundles(say, recorded) -> None:
    say("bundle", "results", "one.zip")
    done = say("compare", "one.zip", "results")
    assert (done.exit_code, done.stdout.splitlines()[0]) == (0, "# stlbench compare: no worse")
    Path("two.zip").write_bytes(b"PK")
    assert refused(say("compare", "one.zip", "two.zip")).startswith("error: two.zip is no bundle")


def test_verify_scores_a_bundle_again(say, recorded) -> None:
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


def test_verify_names_what_is_wrong_with_a_bundle(say, recorded) -> None:
    say("bundle", "results", "mine.zip")
    changed(Path("mine.zip"), Path("other.zip"), {"report.md": b"better"})
    done = say("verify", "other.zip", "--rescore")
    assert done.exit_code == 1
    assert done.stdout.startswith("report.md: 6 bytes, and ro-crate-metadata.json says ")
    assert done.stdout.endswith("other.zip: 2 cells, policies of 2: not what it says\n")


def test_verify_of_a_bundle_whose_results_were_changed_says_no_more_than_that(say, recorded) -> None:
    say("bundle", "results", "mine.zip")
    with ZipFile("mine.zip") as archive:
        lines = archive.read("cells.jsonl")
    changed(Path("mine.zip"), Path("other.zip"), {"cells.jsonl": lines.replace(b"0", b"1", 1)})
    done = say("verify", "other.zip")
    assert (done.exit_code, done.stdout.splitlines()) == (
        1,
        [
            "cells.jsonl: its content is another than when it was packed",
            "other.zip: its results were not read: not what it says",
        ],
    )


def test_options_that_do_not_fit_are_one_line(say, recorded) -> None:
    say("bundle", "results", "mine.zip")
    for words in (("mine.zip", "--repair"), ("results", "--rescore"), ("no.zip",)):
        refused(say("verify", *words))
