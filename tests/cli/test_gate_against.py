"""`stlbench gate --against`: real trainings of two trees by turns. The toy agent trains for a known time of its CPU."""

from __future__ import annotations

import json
import subprocess
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from helpers.refusals import refused

from stlbench.cli import gate

PROJECT = """
[project]
name = "toy-plugins"
[project.entry-points."stlbench.methods"]
toy-raw = "toy_plugins.methods:Raw"
[project.entry-points."stlbench.tasks"]
toy-line = "toy_plugins.line.system:Line"
[project.entry-points."stlbench.agents"]
toy-agent = "toy_plugins.agents:Still"
"""
BUSY = """
import time

def trained(self, training, train=Still.train):
    end = time.process_time() + SECONDS
    while time.process_time() < end:
        pass
    return train(self, training)

Still.train = trained
SECONDS = 0.05
"""
GATE = ("gate", "reference", "--budget", "quick", "--against", "HEAD")


def git(folder: Path, *words: str) -> None:
    who = ("-c", "user.name=toy", "-c", "user.email=toy@example.org")
    subprocess.run(["git", "-C", str(folder), *who, *words], check=True, capture_output=True)


@pytest.fixture
def repository(request, toy, say):
    """The toy plugins in a repository, committed, with a reference in its folder `work`."""
    seeds = 10 if request.node.get_closest_marker("slow") else 2
    (toy / "pyproject.toml").write_text(PROJECT)
    (toy / ".gitignore").write_text("work/\n*.dist-info/\n__pycache__/\n")
    edit(toy / "toy_plugins" / "agents.py", "", BUSY)
    git(toy, "init", "--quiet")
    git(toy, "add", ".")
    git(toy, "commit", "--quiet", "-m", "before")
    chosen = ("--tasks", "toy-line", "--methods", "toy-raw", "--agents", "toy-agent", "--seeds", seeds)
    done = say("gate", "reference", "--update", "--budget", "quick", "--executor", "toy-here", *chosen)
    assert done.exit_code == 0, done.output
    return toy


def edit(file: Path, before: str, after: str) -> None:
    """Replace in a file; append where nothing is to be replaced."""
    text = file.read_text()
    assert before in text
    file.write_text(text.replace(before, after) if before else text + after)


def summary() -> dict[str, dict]:
    found = json.loads(Path("results/gate/gate.json").read_text())
    return {entry["metric"]: entry for entry in found["comparisons"]}


@pytest.mark.slow
def test_training_that_takes_1_3_times_as_long_is_worse(repository, say):
    edit(repository / "toy_plugins" / "agents.py", "SECONDS = 0.05", "SECONDS = 0.065")
    done = say(*GATE)
    assert done.exit_code == 1
    found = summary()
    assert (found["CPU"]["verdict"], found["robustness"]["verdict"]) == ("worse", "no worse")
    assert found["CPU"]["change"] == pytest.approx(1.3, abs=0.06)
    assert found["CPU"]["pairs"] >= 20


@pytest.mark.slow
def test_a_loss_of_robustness_is_worse(repository, say):
    edit(repository / "toy_plugins" / "agents.py", "policy = Always(self.action)", "policy = Always(2)")
    assert say(*GATE).exit_code == 1
    assert summary()["robustness"]["verdict"] == "worse"


@pytest.mark.slow
def test_each_side_has_the_plugins_of_its_own_tree(repository, say):
    """The change moves a module: the base finds its method where it was."""
    git(repository, "mv", "toy_plugins/methods.py", "toy_plugins/rewards.py")
    edit(repository / "pyproject.toml", "toy_plugins.methods:", "toy_plugins.rewards:")
    edit(next(repository.glob("*.dist-info")) / "entry_points.txt", "toy_plugins.methods:", "toy_plugins.rewards:")
    assert say(*GATE).exit_code in (0, 3)
    assert summary()["CPU"]["pairs"] >= 10


@pytest.mark.slow
def test_what_the_base_does_not_know_is_compared_with_the_reference(repository, say):
    edit(repository / "pyproject.toml", 'toy-raw = "toy_plugins.methods:Raw"', "")
    git(repository, "commit", "--quiet", "--all", "-m", "a base without the method")
    edit(repository / "pyproject.toml", 'methods"]', 'methods"]\ntoy-raw = "toy_plugins.methods:Raw"')
    done = say(*GATE)
    assert done.exit_code == 0, done.output
    assert sorted(summary()) == ["robustness", "satisfaction"]


def test_a_change_whose_process_ends_is_worse(repository, say):
    edit(repository / "toy_plugins" / "agents.py", "", "import os\nStill.train = lambda self, training: os._exit(0)\n")
    done = say(*GATE, "--seeds", "2")
    assert done.exit_code == 1
    assert "killed, the base says done: its process ended without a result" in done.stdout


def test_a_base_that_runs_code_of_the_change_is_refused(repository, say, monkeypatch):
    monkeypatch.setenv("OF_THE_CHANGE", str(repository / "late"))
    late = "import os, sys\nsys.path.append(os.environ['OF_THE_CHANGE'])\nimport late\n"
    edit(repository / "toy_plugins" / "methods.py", "", late)
    (repository / "late").mkdir()
    (repository / "late" / "late.py").write_text("")
    git(repository, "commit", "--quiet", "--all", "-m", "imports what is not committed")
    done = say(*GATE, "--seeds", "2")
    assert (done.exit_code, done.stdout) == (2, "")
    assert done.stderr.splitlines()[-1].endswith(f"cannot be measured: its training loads {repository}/late/late.py")


def test_bad_input_is_one_line(repository, say):
    for words, message in (
        (["--against", "nowhere"], "--against nowhere: there is no such revision"),
        (["--against", "--help"], "--against --help: there is no such revision"),
        (["--against", "HEAD", "--update"], "leave out --update and --executor"),
        (["--against", "HEAD", "--executor", "toy-here"], "leave out --update and --executor"),
    ):
        assert message in refused(say("gate", "reference", "--budget", "quick", *words))


def test_a_task_that_is_a_folder_is_refused(repository, say, monkeypatch):
    """The process of a revision would not know it, and say that nothing was measured."""
    planned = gate.cells_of
    in_a_folder = partial(replace, folder=Path("toy-line"))
    monkeypatch.setattr(gate, "cells_of", lambda base: tuple(map(in_a_folder, planned(base))))
    assert "and toy-line is a folder; leave --against out" in refused(say(*GATE))


def test_outside_a_repository(toy, say):
    chosen = ("--tasks", "toy-line", "--methods", "toy-raw", "--agents", "toy-agent", "--seeds", "2")
    assert say("gate", "reference", "--update", "--budget", "quick", "--executor", "toy-here", *chosen).exit_code == 0
    assert "not a git repository" in say(*GATE).stderr
    git(Path.cwd(), "init", "--quiet")
    git(Path.cwd(), "add", ".")
    git(Path.cwd(), "commit", "--quiet", "-m", "no code")
    assert "install it by `pip install -e`" in say(*GATE).stderr
