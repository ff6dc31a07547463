"""`stlbench plan`, with agents that "plan" by doing one thing, so that a cell takes milliseconds."""

from __future__ import annotations

import csv
import importlib
from pathlib import Path

import pytest
from helpers.refusals import refused

from stlbench.registry import plugins

AGENTS = '''
import numpy as np
from stlbench.contract import Agent, StatePolicy, Unsuitable

interrupt = False

class Always(StatePolicy):
    def __init__(self, action, value): self.action, self.expected = action, value
    def episode(self): return lambda state, t, memory: np.full(len(state), self.action)
    def value(self, state): return np.full(len(state), self.expected)

class Best(Agent):
    """Goes down."""
    plans = "formula"
    def __init__(self, *, resolution: float = 1): self.resolution = resolution
    def train(self, training): return Always(0, 1.5)

class Plan(Agent):
    """Stays, or goes up where nothing is discounted."""
    plans = "reward"
    def __init__(self, *, gamma: float = 0.9, resolution: float = 1): self.gamma = gamma
    def train(self, training):
        if interrupt:
            raise KeyboardInterrupt
        if type(training.model.method).__name__ == "Heavy":
            raise Unsuitable("a state of 6 dimensions")
        return Always(2 if self.gamma == 1 else 1, 7.0)
'''
METHODS = '''
from stlbench.contract import RewardMethod

class Light(RewardMethod):
    """Minus x."""
    def arrival(self, signals, t): return -signals[..., 0]

class Later(Light):
    """Minus x, and something for the time."""
    def arrival(self, signals, t): return -signals[..., 0] - 0.5

class Heavy(Light):
    """Does not fit a plan."""
    def arrival(self, signals, t): return signals[..., 0]
'''
ENTRIES = """
[stlbench.agents]
toy-best = toy_plan.agents:Best
toy-plan = toy_plan.agents:Plan
[stlbench.methods]
toy-light = toy_plan.methods:Light
toy-later = toy_plan.methods:Later
toy-heavy = toy_plan.methods:Heavy
"""


@pytest.fixture
def plan(say, toy, site, monkeypatch):
    """Say `plan toy-line`, and further words, where no other agents plan."""
    files = {"__init__": "", "agents": AGENTS, "methods": METHODS}
    site("toy-plan", ENTRIES, {f"toy_plan/{name}.py": text for name, text in files.items()})
    path = toy / "toy_plugins/line/task.yaml"
    path.write_text(path.read_text() + "training:\n  ends: [{where: x > 2.5}]\n")

    def loadable(kind):
        return {name: plugins.find(kind, name).load() for name in ("toy-agent", "toy-best", "toy-plan")}, []

    monkeypatch.setattr(plugins, "loadable", loadable)
    words = ("--methods", "toy-light,toy-later", "--executor", "toy-here")
    return lambda *more: say("plan", "toy-line", *(more if "--methods" in more else (*words[:2], *more)), *words[2:])


def rows(folder="results/plan"):
    with (Path(folder) / "alignment.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_plan_of_each_method_in_each_setting_and_of_the_formula(plan):
    done = plan()
    assert done.exit_code == 0
    found = [(row["method"], row["setting"]) for row in rows()]
    settings = ["recipe", "gamma=1", "without=ends"]
    methods = ("toy-later", "toy-light")
    assert found == [("(formula)", "recipe"), *((method, setting) for method in methods for setting in settings)]
    formula, recipe, undiscounted = rows()[:3]
    assert (formula["satisfied"], formula["grid_value"], recipe["grid_value"]) == ("1.0", "1.5", "7.0")
    best = float(formula["best_known"])  # 1 - x_0, as it goes down; who stays has the same; who goes up, 2 less
    assert float(recipe["reward_optimal"]) == pytest.approx(best)
    assert float(undiscounted["reward_loses"]) == pytest.approx(2)
    assert "Alignment: task toy-line" in done.stdout
    assert "Robustness: " not in done.stdout
    assert done.stderr.splitlines()[0] == "7 cells"


def test_the_same_words_run_nothing_and_more_settings_only_those(plan):
    plan("--settings", "recipe")
    assert plan("--settings", "recipe").stderr == "3 cells, 3 of them done before\n"
    more = plan("--settings", "gamma=1,recipe")
    assert more.stderr.splitlines()[0] == "5 cells, 3 of them done before"
    assert "gamma=1" in more.stdout
    shown = plan("--settings", "gamma=1", "--methods", "toy-light").stdout
    assert ("toy-later" in shown, "recipe" in shown.partition("(formula)")[2].partition("\n")[2]) == (False, False)
    assert len(rows()) == 5


def test_which_methods_pay_for_the_same_is_said(plan):
    lines = plan("--settings", "recipe,without=ends").stdout.splitlines()
    assert [line for line in lines if " is " in line and line.startswith("toy-line")] == [
        "toy-line: toy-light is toy-later plus 0.5 at all times"
    ]


def test_what_cannot_be_planned_is_a_row_with_its_reason(plan):
    done = plan("--methods", "toy-light,toy-heavy", "--settings", "recipe", "--results", "other")
    assert done.exit_code == 0
    assert "unsuitable: a state of 6 dimensions" in done.stdout
    (heavy,) = [row for row in rows("other") if row["method"] == "toy-heavy"]
    assert (heavy["reward_optimal"], heavy["remarks"]) == ("", "unsuitable: a state of 6 dimensions")


def test_what_is_wrong_is_one_line_and_nothing_is_written(plan):
    for words, message in (
        (("--methods", "toy-lite"), "no method 'toy-lite'; did you mean 'toy-light'"),
        (("--settings", "recipes"), "settings: 'recipes' is no setting; a setting is recipe, without=PART+PART or"),
        (("--settings", "without=cuts"), "toy-line[without=cuts]: the task is without cuts as it is"),
        (("--settings", "gama=1"), "toy-plan[gama=1]: no parameter 'gama'; did you mean 'gamma'?"),
        (("--resolution", "fine"), "Invalid value for '--resolution': should be a number"),
        (("--resolution", "nan"), "toy-best[resolution=nan]: resolution should be a finite number, got 'nan'"),
    ):
        assert refused(plan(*words)).startswith(f"error: {message}")
    assert not Path("results").exists()


def test_an_interrupt_says_how_to_go_on(plan, monkeypatch):
    plan("--settings", "recipe")
    agents = importlib.import_module("toy_plan.agents")
    monkeypatch.setattr(agents, "interrupt", True)
    done = plan("--settings", "recipe,gamma=1")
    assert done.exit_code == 130
    said = "interrupted: 3 of 5 cells are recorded in results/plan/; run the same command again to continue"
    assert done.stderr.splitlines()[-1] == said
    monkeypatch.setattr(agents, "interrupt", False)
    assert plan("--settings", "recipe,gamma=1").exit_code == 0
