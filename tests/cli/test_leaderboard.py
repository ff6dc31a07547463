"""`stlbench leaderboard`, on made-up plugins."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from helpers.bundles import changed

RUN = ("run", "--tasks", "toy-line", "--agents", "toy-agent", "--executor", "toy-here", "--methods", "toy-raw")


@pytest.fixture
def mine(say, toy) -> None:
    assert say(*RUN, "--seeds", "10-14").exit_code == 0
    assert say("bundle", "results", "mine.zip", "--author", "Ada Lovelace").exit_code == 0


def test_a_bundle_becomes_rows(say, mine) -> None:
    done = say("leaderboard", "mine.zip", "--draw", "7")
    assert done.exit_code == 0
    assert done.stdout.splitlines()[0] == "Results: agent toy-agent, budget quick, track shared"
    assert done.stdout.endswith("Written to leaderboard/: scores.json, table.md, table.csv; 1 bundles, 0 refused\n")
    assert done.stderr.splitlines() == [f"toy-line/toy-raw/toy-agent/{seed}: as recorded" for seed in range(10, 15)]
    assert "Ada Lovelace" in Path("leaderboard/table.md").read_text()


def test_json(say, mine) -> None:
    done = say("leaderboard", "mine.zip", "--draw", "7", "--json")
    said = json.loads(done.stdout)
    assert (done.stderr, said["fine"], said["draw"], said["refused"]) == ("", True, 7, [])
    (row,) = said["results"]
    assert (row["task"], row["seeds done"], row["record"], row["bundle"]) == ("toy-line", 5, "as recorded", "mine")
    assert said["bundles"][0]["by"] == "Ada Lovelace"


def test_what_is_refused_is_said_and_is_a_failure(say, mine) -> None:
    changed(Path("mine.zip"), Path("changed.zip"), {"cells.jsonl": b"{}"})
    done = say("leaderboard", "changed.zip", "mine.zip")
    assert done.exit_code == 1
    assert "changed.zip is refused: cells.jsonl: 2 bytes, and" in " ".join(done.stdout.split())
    assert "; 1 bundles, 1 refused" in done.stdout
    assert json.loads(say("leaderboard", "changed.zip", "--json").stdout)["refused"][0]["bundle"] == "changed.zip"


def test_bad_input_is_one_line(say) -> None:
    for words in (("no.zip",), (), ("no.zip", "--draw", "-1")):
        done = say("leaderboard", *words)
        assert (done.exit_code, done.stdout, len(done.stderr.splitlines())) == (2, "", 1)
