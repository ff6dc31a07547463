"""`stlbench tune` on toys, and a run by the recipes that it found."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest
import yaml

from stlbench.study.cell import read_recipes

TUNE = ("tune", "--tasks", "toy-line", "--methods", "toy-raw,toy-large", "--trials", "8", "--executor", "toy-here")


@pytest.fixture
def tunable(toy):
    """The toy agent may be tuned. By its recipe it moves right, out of where it should stay; 1 stands still."""
    path = toy / "toy_plugins/agents.py"
    space = '    search_space = {"action": (0, 1, 2), "hold": (1, 2, 3)}\n'
    doc = '    """Learns nothing: its policy takes one action."""\n'
    path.write_text(path.read_text().replace(doc, doc + space))
    task = toy / "toy_plugins/line/task.yaml"
    task.write_text(task.read_text().replace("{action: 1}", "{action: 2}"))


def trials() -> list[dict[str, str]]:
    with Path("results/tuning/trials.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_recipes_and_trials_are_written_and_the_same_words_train_nothing(say, tunable):
    done = say(*TUNE)
    assert done.exit_code == 0, done.stderr
    assert "at most 32 cells" in done.stderr
    rows = trials()
    assert [row["method"] for row in rows] == ["toy-raw"] * 8 + ["toy-large"] * 2
    assert (rows[0]["action"], rows[0]["hold"], rows[0]["status"]) == ("2", "1", "done")  # the task's recipe
    assert {row["status"] for row in rows[8:]} == {"intractable"}
    (chosen,) = [row for row in rows if row["chosen"]]
    assert chosen["action"] in ("0", "1")
    content = yaml.safe_load(Path("results/tuning/recipes.yaml").read_text())
    assert (content["trials"], content["seeds"], content["budget"]) == (8, [100, 101], "quick")
    found = read_recipes(Path("results/tuning/recipes.yaml")).found["toy-line"]["toy-agent"]
    assert found["toy-raw"].agent == {"action": int(chosen["action"])}
    assert found["toy-large"].agent == {}
    again = say(*TUNE)
    assert again.exit_code == 0
    assert " done: " not in again.stderr
    assert trials() == rows
    by_them(say)


def by_them(say):
    """The track tuned trains by the recipes that were found."""
    words = ("run", "--tasks", "toy-line", "--methods", "toy-raw,toy-large", "--executor", "toy-here")
    shared = say(*words)
    tuned = say(*words, "--track", "tuned", "--recipes", "results/tuning/recipes.yaml")
    assert (shared.exit_code, tuned.exit_code) == (0, 0), tuned.stderr
    with Path("results/cells.csv").open(newline="") as file:
        rows = {(row["method"], row["track"], row["seed"]): row for row in csv.DictReader(file)}
    assert len(rows) == 8
    better, worse = (float(rows["toy-raw", track, "0"]["robustness_mean"]) for track in ("tuned", "shared"))
    assert better > worse
    assert rows["toy-large", "tuned", "0"]["status"] == "intractable"


def test_bad_input_is_one_line(say, tunable):
    run = ("run", "--tasks", "toy-line", "--methods", "toy-raw", "--executor", "toy-here")
    for words, message in (
        ((*TUNE, "--seeds", "3"), "seeds below 100 are for reports, not for tuning; say --seeds 100-101"),
        ((*TUNE, "--agents", "planner"), "agent planner has nothing to tune: it declares no search_space"),
        ((*run, "--track", "tuned"), "track tuned, and no other, needs a file of recipes"),
        ((*run, "--recipes", "none.yaml"), "cannot read the recipes none.yaml"),
        ((*run, "--track", "fine"), "track: should be 'auto', 'shared', 'plain' or 'tuned'"),
    ):
        done = say(*words)
        assert done.exit_code == 2
        assert message in " ".join(done.stderr.split())
