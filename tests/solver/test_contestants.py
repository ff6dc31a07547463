"""The contestants of a race of `stlbench solve`: who they are, by which schedule, and who goes on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest
from solver.conftest import FORMULA

from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, parse_choice
from stlbench.simulation.environment import BatchEnvironment
from stlbench.solver.contestants import (
    Contestant,
    again,
    along,
    better_half,
    by_second_recipe,
    contestants,
    cost,
    gains,
    rank,
)
from stlbench.solver.problem import Problem
from stlbench.solver.workspace import TASK, workspace_of
from stlbench.task import build_agent, build_method, load_task
from stlbench.tracks.auto import automatic
from stlbench_agents.td3 import TD3


def test_a_linear_policy_has_a_number_for_each_axis_and_entry() -> None:
    task = automatic(workspace_of(Problem("CartPole-v1", FORMULA), Path("out")).task, "dqn")
    seen = BatchEnvironment(task, build_method(task, "tltl"), 1, 0)
    assert gains(Contestant("tltl", "cma-es")) == seen.time_column  # one axis


def test_methods_that_race() -> None:
    task = workspace_of(Problem("CartPole-v1", FORMULA), Path("out")).task
    methods = contestants(task, 10)
    assert methods[:2] == (Contestant("funnel", "dqn"), Contestant("raw", "dqn"))
    assert {each.agent for each in methods} == {"dqn"}
    assert contestants(task, 60)[-1] == Contestant("funnel", "sb3-dqn")  # with much time another agent races
    assert len(contestants(task, 60)) == 4
    again = workspace_of(Problem("Pendulum-v1", "G[0,50] F[0,20] x >= 0"), Path("other")).task
    assert contestants(again, 10)[0] == Contestant("funnel", "td3")  # its schedule has no F inside of G
    assert len(contestants(again, 10)) <= 4
    assert "cfer" not in {each.method for each in contestants(again, 10)}  # which td3 trains as it does flag


def test_who_goes_on_trains_on_the_formula_as_it_is_if_it_did_so_before() -> None:
    nested = workspace_of(Problem("CartPole-v1", "F[0,40] (x >= 0.3 & F[0,40] x <= -0.3)"), Path("out")).task
    by = {choice: Contestant("tltl", "cma-es", parse_choice(choice)) for choice in ("task[without=schedule]", "task")}
    assert [str(again(who, nested).task) for who in by.values()] == [*by]
    assert again(Contestant("raw", "dqn", parse_choice("task[schedule=wide]")), nested).task == TASK
    plain = workspace_of(Problem("CartPole-v1", FORMULA), Path("plain")).task
    assert again(by["task[without=schedule]"], plain).task == TASK


def test_who_races_by_another_schedule() -> None:
    """All follow it, and the first also the schedule of the probe. Without another schedule nothing changes."""
    racing = tuple(Contestant(method, "dqn") for method in ("funnel", "raw", "counters", "dense"))
    assert along(racing, [TASK]) == racing
    witnessed = parse_choice("task[schedule=witness]")
    found = along(racing, [witnessed, TASK])
    assert [each.method for each in found] == ["funnel", "raw", "counters", "dense", "funnel"]
    assert [each.task for each in found] == [witnessed] * 4 + [TASK]
    assert str(found[0]) == "funnel by schedule witness"


def test_who_races_by_a_second_recipe() -> None:
    """Those of an environment, if their agent has one."""
    racing = tuple(Contestant(method, agent) for method, agent in (("funnel", "td3"), ("raw", "td3"), ("raw", "dqn")))
    task = workspace_of(Problem("Pendulum-v1", "F[0,50] x >= 0.9"), Path("out")).task
    found = by_second_recipe(racing, task)
    assert [(each.method, each.agent) for each in found] == [
        ("funnel", "td3[copies=32,gradient_steps=8]"),
        ("raw", "td3[copies=32,gradient_steps=8]"),
        ("raw", "dqn"),
    ]
    assert build_agent(automatic(task, "td3"), found[0].agent) == replace(
        build_agent(automatic(task, "td3"), "td3"), copies=32, gradient_steps=8
    )
    assert by_second_recipe(racing, load_task("zones")) == racing  # states of a system can be set


@pytest.mark.parametrize("entries", [3, {"copies": [1, 2]}, [("copies", 3, 4)], {"a b": 1}])
def test_a_wrong_second_recipe_is_told_with_its_agent(monkeypatch: pytest.MonkeyPatch, entries: object) -> None:
    task = workspace_of(Problem("Pendulum-v1", "F[0,50] x >= 0.9"), Path("out")).task
    monkeypatch.setattr(TD3, "second_recipe", entries)
    with pytest.raises(UsageError, match=r"td3.*its second_recipe should have parameters, and numbers or words as"):
        by_second_recipe([Contestant("raw", "td3")], task)


def test_the_cost_of_a_cell_is_that_apart_from_its_checkpoints_and_that_of_a_step() -> None:
    curve = [SimpleNamespace(starts=starts) for starts in (8, 8, 64)]
    measured = SimpleNamespace(wall_seconds=30.0, training_wall_seconds=10.0, env_steps=20_000, curve=curve)
    result = cast(Result, SimpleNamespace(measurement=measured))
    assert cost(result, 0.125) == (10.0, 0.0005)
    assert cost(result, 0.5)[0] == 0.0  # episodes that end early take less time than a whole one


def test_where_no_method_fits_each_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    workspace = workspace_of(Problem("CartPole-v1", "F[0,20] (x > 0 S theta > 0)"), Path("out"))
    own = {"causation": plugins.find("methods", "causation")}
    available = plugins.available
    monkeypatch.setattr(plugins, "available", lambda kind: own if kind == "methods" else available(kind))
    with pytest.raises(UsageError, match=r"^no method fits the formula F\[0,20\] .*; causation: it takes G"):
        contestants(workspace.task, 3.0)


@pytest.mark.parametrize(
    ("scores", "kept"),
    [
        ({"funnel": (0.5, -1.0), "raw": (0.0, 9.0), "dense": (0.7, -2.0), "tltl": (0.1, 0.0)}, ["dense", "funnel"]),
        ({"funnel": (0.0, -9.0), "raw": (0.0, -20.0), "dense": (0.0, -1.0), "tltl": (0.0, 0.0)}, ["funnel", "raw"]),
        ({"funnel": (0.0, -9.0), "raw": None, "dense": (0.0, -1.0)}, ["funnel", "dense"]),
        ({"funnel": None, "raw": None}, ["funnel"]),
    ],
)
def test_if_nobody_satisfies_the_first_in_the_race_go_on(
    scores: dict[str, tuple[float, float] | None], kept: list[str]
) -> None:
    results = list[Result]()
    for method, score in scores.items():
        at = None if score is None else SimpleNamespace(satisfaction=score[0], robustness_mean=score[1])
        cell = CellId(Choice("task"), Choice(method), Choice("td3"), 101, "rung-1", "auto")
        measured = None if at is None else SimpleNamespace(selection=at)
        results.append(cast(Result, SimpleNamespace(id=cell, measurement=measured)))
    ranked = sorted(results, key=rank, reverse=True)
    racing = [Contestant(method, "td3", Choice("task")) for method in scores]
    assert [each.method for each in better_half(ranked, racing)] == kept
