"""`stlbench run` with agents that plan: cells like any other, without environment steps; and tasks that do not fit."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

METHODS = '''
import numpy as np
from stlbench.contract import RewardMethod

class Below(RewardMethod):
    """How far x is below 1."""
    def arrival(self, signals, t): return 1 - signals[..., 0]

class History(RewardMethod):
    """Remembers where it was, to the last digit."""
    memory_size = 22
    def along(self, samples, action, t, memory):
        for signals in samples[:-1]:
            memory = np.roll(memory, 1, axis=1) + signals + action
        return -samples[1:, :, 0], memory

class Nothing(RewardMethod):
    """Pays no number."""
    def arrival(self, signals, t): return np.full(signals.shape[:-1], np.nan)
'''
ENTRIES = """
[stlbench.methods]
toy-below = toy_rewards:Below
toy-history = toy_rewards:History
toy-nothing = toy_rewards:Nothing
[stlbench.tasks]
toy-wide = toy_tasks.wide.system:Wide
toy-hidden = toy_tasks.hidden.system:Hidden
toy-until = toy_tasks.until.system:Until
"""
TASK = """
title: A made-up task
source: made up
formula: {formula}
sampling_time: 0.5
steps: 4
signals:
  x: {{low: -2, high: 3}}
actions:
  v: {{low: -1, high: 1, count: 3}}
initial:
  box: {{{box}}}
starts: 8
agents: {{toy-agent: {{}}}}
budgets:
  quick: {{steps: 8, seeds: 1, deadline: 60, random_starts: 0}}
"""
SYSTEM = """
from stlbench.contract import System

class {name}(System):
    state = {state}
    def step(self, state, action): return state + self.dt * action
    def signals(self, state): return state[..., :1]
    def features(self, state, t): return state
"""


def task(folder: str, name: str, columns: str, formula: str) -> dict[str, str]:
    """The files of a task whose state has these columns, of which the first is a signal."""
    box = ", ".join(f"{column}: [-1, 0.9]" for column in columns)
    return {
        f"toy_tasks/{folder}/__init__.py": "",
        f"toy_tasks/{folder}/system.py": SYSTEM.format(name=name, state=tuple(columns)),
        f"toy_tasks/{folder}/task.yaml": TASK.format(formula=formula, box=box),
    }


@pytest.fixture
def run(say, toy, site):
    """Say `run` on made-up tasks, with planners."""
    files = {"toy_rewards.py": METHODS, "toy_tasks/__init__.py": ""}
    files |= task("wide", "Wide", "xabcd", "G[0,4] (x <= 1)")
    files |= task("hidden", "Hidden", "xa", "G[0,4] (x <= 1)")
    files |= task("until", "Until", "x", "(x <= 1) U[0,4] (x >= 0)")
    site("toy-rewards", ENTRIES, files)
    return lambda *words: say("run", "--executor", "toy-here", "--seeds", "1", *words)


def cells(folder: str = "results") -> list[dict[str, str]]:
    """The rows of a run, without what is measured in seconds."""
    with Path(folder, "cells.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return [{key: value for key, value in row.items() if "seconds" not in key} for row in rows]


WORDS = "--tasks", "toy-line", "--methods", "toy-below", "--agents", "planner[gamma=1],best-possible"


@pytest.mark.slow
def test_planned_cells_are_cells_like_any_other(run):
    """G[0,4] x <= 1 is decided by where x begins, so the grid promises just what the referee finds."""
    done = run(*WORDS)
    assert (done.exit_code, [row["status"] for row in cells()]) == (0, ["done", "done"]), done.stderr
    best, planned = cells()
    assert (best["maximised"], planned["maximised"]) == ("formula", "reward")
    assert best["robustness_mean"] == best["final_robustness_mean"]
    assert float(best["grid_value"]) == pytest.approx(float(best["robustness_mean"]))
    assert {row["env_steps"] for row in cells()} == {row["selected_steps"] for row in cells()} == {"0"}


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("toy-wide", "toy-below", "planner"), "a state of 5 dimensions; a grid has at most 4"),
        (("toy-line", "toy-below", "planner[resolution=100000]"), "an axis x of 200000001 points; it may have 10000"),
        (("toy-until", "toy-below", "best-possible"), "until at"),
    ],
)
def test_what_does_not_fit_is_a_row_with_the_reason(run, words, reason):
    task, method, agent = words
    done = run("--tasks", task, "--methods", method, "--agents", agent)
    assert done.exit_code == 2, done.stderr
    (row,) = cells()
    assert row["status"] == "unsuitable"
    assert reason in row["reason"]
    assert f"{task}/{method}/{agent}/0 unsuitable: {reason}" in " ".join(done.stderr.split())


def test_a_reward_that_is_no_number_fails_its_cell_with_a_line(run):
    done = run("--tasks", "toy-line", "--methods", "toy-nothing", "--agents", "planner")
    (row,) = cells()
    assert "the method's reward is sometimes not a number" in row["reason"]
    assert row["status"] == "raised", done.stderr
