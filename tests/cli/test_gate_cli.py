"""`stlbench compare` and `stlbench gate`: every exit code on made-up plugins."""

from __future__ import annotations

import csv
import importlib
import json
import re
from pathlib import Path

import pytest
from helpers.refusals import refused

TOY = ("--tasks", "toy-line", "--agents", "toy-agent", "--budget", "quick")
HERE = ("--executor", "toy-here")
GATE = ("gate", "reference", "--budget", "quick", *HERE)


@pytest.fixture
def reference(once):
    """Make a reference of the methods named."""
    words = ("gate", "reference", "--update", *TOY, *HERE)
    return lambda methods="toy-raw", seeds="3": once(*words, "--methods", methods, "--seeds", seeds)


def edit_reference(pattern, text):
    """Replace in each line of its table."""
    table = Path("reference/cells.csv")
    table.write_text(re.sub(pattern, text, table.read_text(), flags=re.MULTILINE))


@pytest.fixture
def methods(toy):
    """The module of the toy methods, as the cells see it."""
    return importlib.import_module("toy_plugins.methods")


def rows(path="reference/cells.csv"):
    with Path(path).open(newline="") as file:
        return list(csv.DictReader(file))


def summary(folder="results/gate"):
    return json.loads(Path(folder, "gate.json").read_text())


def test_update_writes_a_reference(say, toy):
    done = say("gate", "reference", "--update", *TOY, *HERE, "--methods", "toy-raw,toy-large", "--seeds", "3")
    assert done.stdout == "Written to reference/: cells.csv, provenance.json; 6 cells\n"
    assert [(row["method"], row["seed"], row["status"]) for row in rows()] == [
        *(("toy-large", seed, "intractable") for seed in "012"),
        *(("toy-raw", seed, "done") for seed in "012"),
    ]
    assert {"machine", "numpy", "python", "jobs"} <= json.loads(Path("reference/provenance.json").read_text()).keys()
    assert sorted(path.name for path in Path("reference").iterdir()) == ["cells.csv", "provenance.json"]


def test_update_writes_no_reference_of_cells_that_failed(say, toy):
    done = say("gate", "reference", "--update", *TOY, *HERE, "--methods", "toy-raw,toy-wrong", "--seeds", "1")
    assert done.exit_code == 1
    assert done.stderr.endswith(
        "toy-line/toy-wrong/toy-agent/0 raised: ValueError: no [such] luck\n"
        "1 of 2 cells failed; no reference was written\n"
    )
    assert not Path("reference").exists()


def test_equal_code_is_no_worse(reference, say):
    reference("toy-raw,toy-large")
    done = say(*GATE)
    assert done.exit_code == 0
    assert done.stdout.startswith("# stlbench gate: no worse\n")
    assert "| toy-line | toy-raw | toy-agent | quick  | shared |     3 |" in done.stdout
    assert Path("results/gate/gate.md").read_text() == done.stdout
    found = summary()
    assert (found["verdict"], found["exit_code"], found["findings"]) == ("no worse", 0, [])
    assert (found["base"]["path"], found["base"]["cells"]) == ("reference", 6)
    first, second = found["comparisons"][:2]
    assert first == {
        "task": "toy-line", "method": "toy-raw", "agent": "toy-agent", "budget": "quick", "track": "shared",
        "metric": "robustness", "pairs": 3, "base": first["base"], "new": first["base"],
        "change": 0.0, "low": 0.0, "high": 0.0, "tolerated": -0.05, "p_value": 1.0, "verdict": "no worse",
    }  # fmt: skip
    assert (second["metric"], second["pairs"], second["change"]) == ("satisfaction", 3, 0.0)
    assert json.loads(say("compare", "reference", "reference", "--json").stdout)["comparisons"][0] == first


def test_a_cost_beside_a_reference_is_information(reference, say):
    reference()
    edit_reference(r",[0-9.]*,[0-9.]*$", ",1e-9,1e-9")  # seconds and nanoseconds that none can keep to
    done = say(*GATE)
    assert done.exit_code == 0
    costs = [entry for entry in summary()["comparisons"] if entry["metric"] in ("CPU", "reward")]
    assert [(entry["verdict"], entry["low"], entry["p_value"]) for entry in costs] == [("not judged", None, None)] * 2
    assert all(entry["change"] > 100 for entry in costs)
    assert re.search(r"\(x\d+.*\) \| \(x\d+.*\) \|", done.stdout)


@pytest.mark.parametrize(("seeds", "code", "verdict"), [("3", 1, "worse"), ("2", 3, "cannot tell")])
def test_worse_is_exit_code_1_and_too_few_seeds_are_3(reference, say, monkeypatch, seeds, code, verdict):
    reference(seeds=seeds)
    # The agent stands still at each start: moving right at every step instead loses 2 m of robustness.
    monkeypatch.setattr(importlib.import_module("toy_plugins.agents").Still, "train", moved_right)
    done = say(*GATE, "--results", "other")
    assert (done.exit_code, done.stdout.splitlines()[0]) == (code, f"# stlbench gate: {verdict}")
    table = done.stdout.partition("## What is not fine")[2].partition("## All groups")[0]
    assert ("| worse   | toy-line/toy-raw/toy-agent | robustness" in table) == (code == 1)


def moved_right(self, training):
    import numpy as np

    environment = training.make(2)
    environment.reset()
    for _ in range(training.steps // 2):
        environment.step(np.array([2, 2]))
    policy = importlib.import_module("toy_plugins.agents").Always(2)
    training.report(policy, training.steps)
    return policy


def test_a_cell_that_crashes_now_is_worse_with_its_reason(reference, say, methods, monkeypatch):
    reference()
    monkeypatch.setattr(methods.Raw, "along", methods.Wrong.along)
    done = say(*GATE, "--results", "other")
    assert done.exit_code == 1
    assert "| toy-line/toy-raw/toy-agent/0 |" in done.stdout
    assert "raised, the base says done: ValueError: no [such] luck" in done.stdout
    found = json.loads(Path("other/gate.json").read_text())
    assert [entry["verdict"] for entry in found["findings"]] == ["worse"] * 3
    monkeypatch.undo()


def test_options_choose_from_the_reference(reference, say):
    reference("toy-raw,toy-large")
    chosen = ("--seeds", "0,2", "--tasks", "toy-line", "--agents", "toy-agent", "--json")
    done = say(*GATE, "--methods", "toy-raw", *chosen)
    found = json.loads(done.stdout)
    assert (done.exit_code, found["base"]["cells"], found["new"]["cells"]) == (0, 2, 2)
    assert say(*GATE, "--methods", "toy-large").exit_code == 4  # nothing is measured


def test_ctrl_c_keeps_what_is_done(reference, say, monkeypatch):
    reference()
    monkeypatch.setattr(importlib.import_module("toy_plugins.agents"), "interrupt_after", 3)
    done = say(*GATE, "--results", "other")
    assert done.exit_code == 130
    assert done.stderr.splitlines()[-1] == "interrupted; the same command goes on with what is recorded in other/"
    monkeypatch.setattr(importlib.import_module("toy_plugins.agents"), "interrupt_after", None)
    assert say(*GATE, "--results", "other").stderr.splitlines()[0] == "3 cells, 1 of them done before"


def test_compare_takes_folders_ledgers_and_references(reference, say):
    reference()
    say("run", *TOY, *HERE, "--methods", "toy-raw", "--seeds", "3")
    for base, new in (("reference", "results"), ("results/ledger.sqlite", "results/gate"), ("results", "reference")):
        done = say("compare", base, new)
        assert (done.exit_code, done.stdout.splitlines()[0]) == (0, "# stlbench compare: no worse")


def test_compare_misses_cells(reference, say):
    reference()
    say("run", *TOY, *HERE, "--methods", "toy-raw", "--seeds", "2")
    done = say("compare", "reference", "results")
    assert done.exit_code == 4
    assert "| missing | toy-line/toy-raw/toy-agent/2 |" in done.stdout
    assert "there is no result of it, and the base says done" in done.stdout
    more = say("compare", "results", "reference")
    assert more.exit_code == 0
    assert "- Cells of the new snapshot alone, which were not compared: 1." in more.stdout


def test_bad_input_exits_2_with_one_line(reference, say):
    reference()
    for words, message in (
        (["compare", "nowhere", "reference"], "there is neither nowhere/ledger.sqlite nor cells.jsonl"),
        (["compare", ".", "reference"], ". has neither ledger.sqlite nor cells.csv"),
        (["gate", "nowhere"], "there is no reference at nowhere; --update with --tasks and --methods makes one"),
        (["gate", "reference"], "the reference has no cells of budget 'smoke'; there are: quick"),
        ([*GATE, "--methods", "toy-rwa"], "the reference has no cells of method 'toy-rwa'; did you mean 'toy-raw'?"),
        ([*GATE, "--seeds", "4"], "the reference has no cells of seed '3'; there are: 0, 1, 2"),
        ([*GATE, "--results", "reference"], "--results reference is the reference itself"),
    ):
        assert message in refused(say(*words))
