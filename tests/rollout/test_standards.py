"""What policies are compared with, of tasks that are installed, and of others."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from helpers.line_task import line, steered

from stlbench.contract import Array, Integers
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, parse_choices
from stlbench.rollout import standards
from stlbench.task.file import BestPossible
from stlbench.task.task import Task


@pytest.fixture(autouse=True)
def tasks(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Instead of installed tasks; the names that were asked for."""
    asked = list[str]()

    def broken(state: Array, t: Integers) -> Array:
        raise ValueError("no\nsuch luck")

    tasks = {
        "up": steered(lambda state, t: np.ones_like(state)),
        "down": steered(lambda state, t: -np.ones_like(state)),
        "broken": steered(broken),
        "none": line(best_possible={"reached": 0.25, "coarser": 0.125}),
    }

    def load(choice: Choice) -> Task:
        name = str(choice)
        asked.append(name)
        if name == "torn":
            raise ImportError("it needs the extra mujoco")
        if name == "unmade":
            raise OSError("its table is not there")
        if name not in tasks:
            plugins.find("tasks", name)
        return tasks[name]

    monkeypatch.setattr(standards, "load_task", load)
    return asked


def test_a_task_is_scored_once(tasks: list[str]) -> None:
    found = standards.standards(parse_choices("up,down,up[without=cuts]"))
    assert list(found) == tasks == ["up", "down"]
    scores = [standard.by_hand for standard in found.values()]
    assert [score and score.satisfaction for score in scores] == [0, 1]


def test_the_task_file_says_what_is_possible_and_which_agent_is_its_own() -> None:
    none = standards.standards([Choice("none")])["none"]
    assert none == standards.Standard(None, BestPossible(reached=0.25, coarser=0.125), "dqn")


def test_what_cannot_be_loaded_is_left_out_silently() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = standards.standards(map(Choice, ("gone", "none", "torn", "../x", "", "down")))
    assert list(found) == ["none", "down"]


def test_a_controller_that_fails_is_a_warning() -> None:
    with pytest.warns(plugins.PluginWarning) as told:
        found = standards.standards(parse_choices("broken,unmade,up"))
    assert [(name, standard.by_hand is None) for name, standard in found.items()] == [("broken", True), ("up", False)]
    assert [str(entry.message) for entry in told] == [
        "task line: its controller cannot be scored: ValueError: no such luck",
        "task unmade: its controller cannot be scored: OSError: its table is not there",
    ]
