"""What policies are compared with, of tasks that are installed, and of others."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from helpers.line_task import line, steered

from stlbench.contract import Array, Integers
from stlbench.records.identity import Setting, Track
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, parse_choices
from stlbench.task.file import BestKnown
from stlbench.task.task import Task
from stlbench.tracks import references
from stlbench_methods.raw import Raw


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
        "lost": steered(lambda state, t: state * np.nan),
        "narrow": line(formula="F[0,8] (abs(x - 5) <= 0.1)", initial={"box": {"x": [-1, 5]}}),
        "none": line(best_known={"robustness": 0.25, "upper_bound": 0.5}),
    }

    def load(choice: Choice) -> Task:
        name = str(choice)
        asked.append(name)
        if name == "torn":
            raise ImportError("it needs the extra mujoco")
        if name == "unmade":
            raise OSError("its table is not there")
        if choice.name not in tasks:
            plugins.find("tasks", name)
        return tasks[choice.name]

    monkeypatch.setattr(references, "load_task", load)
    return asked


def settings(tasks: str, *methods: str, track: Track = "shared") -> list[Setting]:
    chosen = methods or ("raw",)
    return [
        Setting(task, Choice(method), Choice("dqn"), "quick", track)
        for task in parse_choices(tasks)
        for method in chosen
    ]


def test_a_task_is_scored_once(tasks: list[str]) -> None:
    found = references.references(settings("up,down,up[without=cuts]"))
    assert list(found) == ["up", "down"]
    # to know of it, by its controller, at random, by constant actions
    assert tasks == ["up", "down", *["up"] * 3, *["down"] * 3]
    scores = [reference.by_hand for reference in found.values()]
    assert [score and score.satisfaction for score in scores] == [0, 1]


def test_the_task_file_says_what_is_best_known_and_which_agent_is_its_own() -> None:
    found = references.references(settings("none,up"))
    best = BestKnown(robustness=0.25, upper_bound=0.5)
    assert (found["none"].by_hand, found["none"].best_known, found["none"].own_agent) == (None, best, "dqn")
    assert found["up"].by_hand is not None
    assert found["up"].at_random is not None
    assert found["up"].at_random.starts == found["up"].by_hand.starts


def test_a_task_that_a_constant_action_solves_is_trivial() -> None:
    """Of G[0,4] x <= 1 from [-1, 1]: to go down is enough. To 5 +- 0.1 no action leads from all starts."""
    found = references.references(settings("down,up,narrow"))
    assert {name: reference.trivial for name, reference in found.items()} == {"down": True, "up": True, "narrow": False}
    zero, constant = found["narrow"].zero, found["narrow"].constant
    assert zero is not None
    assert constant is not None
    assert zero.satisfaction <= constant.satisfaction < 0.95


def test_methods_that_pay_the_same_are_known_by_task_and_track() -> None:
    """No term is active after step 4: until then the funnel is raw less a constant. It has no F, so no t* either."""
    late = "funnel[t_star=0.7]"
    chosen = settings("up,up[without=cuts]", "raw", "funnel", late) + settings("up", "raw", "funnel", track="plain")
    found = references.references(chosen)["up"]

    def likeness(one: str, other: str, task: str = "up", track: Track = "shared") -> str | None:
        both = settings(task, one, other, track=track)
        assert found.likeness(*both) == found.likeness(*reversed(both))
        return found.likeness(*both)

    assert likeness("funnel", late) == "="
    assert likeness("raw", "funnel") == likeness("raw", late) == "~"
    assert likeness("raw", "funnel", "up[without=cuts]") == likeness("raw", "funnel", track="plain") == "~"
    assert likeness("raw", late, track="plain") is None  # nobody asked
    assert likeness("raw", "flag") is None


def test_what_cannot_be_loaded_is_left_out_silently() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        names = ("gone", "none", "torn", "../x", "", "down")
        found = references.references(Setting(Choice(name), Choice("raw"), Choice("dqn"), "quick") for name in names)
    assert list(found) == ["none", "down"]


def test_a_controller_that_fails_is_a_warning() -> None:
    with pytest.warns(plugins.PluginWarning) as told:
        found = references.references(settings("broken,lost,unmade,up"))
    assert [(name, each.by_hand is None) for name, each in found.items()] == [
        *(("broken", True), ("lost", True), ("up", False)),
    ]
    assert [str(entry.message) for entry in told] == [
        "task unmade: it cannot be loaded: OSError: its table is not there",
        "task broken: its controller cannot be scored: ValueError: no such luck",
        "task lost: its controller cannot be scored: line, by hand: an action has v nan; v is in [-1, 1]",
    ]


def test_a_method_that_cannot_be_asked_leaves_the_scores_of_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(self: Raw, signals: Array, t: Integers) -> Array:
        raise ValueError("no such luck")

    monkeypatch.setattr(Raw, "arrival", broken)
    with pytest.warns(
        plugins.PluginWarning, match=r"^task up: method raw cannot be asked what it pays: ValueError: no such luck$"
    ):
        found = references.references(settings("up", "raw", "funnel"))["up"]
    assert found.by_hand is not None
    assert not found.alike
