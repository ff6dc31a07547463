"""Which cells say what a reward asks for."""

from __future__ import annotations

from collections.abc import Sequence

import pytest

from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, parse_choices
from stlbench.study.plan import PlanSetting, check_cells, default_settings, parse_settings, plan_alignment

GAMMA = (("gamma", "1"),)


@pytest.mark.parametrize(
    ("text", "settings"),
    [
        ("recipe", [PlanSetting()]),
        ("gamma=1, without=cuts+ends", [PlanSetting("", GAMMA), PlanSetting("cuts+ends")]),
        ("without=cuts gamma=1,gamma=1  without=cuts", [PlanSetting("cuts", GAMMA)]),
        ("gamma=1 actions=9", [PlanSetting("", (("actions", "9"), *GAMMA))]),
    ],
)
def test_settings(text: str, settings: Sequence[PlanSetting]) -> None:
    assert parse_settings(text) == tuple(settings)


@pytest.mark.parametrize("item", ["", " ", "gamma", "recipe gamma=1", "gamma=1 gamma=2", "=1", "gamma=[1]", "recipes"])
def test_what_is_no_setting(item: str) -> None:
    with pytest.raises(UsageError, match=r"^settings: '.*' is no setting; a setting is recipe, without=") as caught:
        parse_settings(f"recipe,{item}")
    assert "\n" not in str(caught.value)


def test_by_default_each_part_that_a_task_has_is_left_out_once() -> None:
    parts = [PlanSetting("cuts"), PlanSetting("ends"), PlanSetting("rewarded")]
    assert default_settings(Choice("cartpole")) == (PlanSetting(), PlanSetting("", GAMMA), *parts)
    assert default_settings(Choice("overlap")) == (PlanSetting(), PlanSetting("", GAMMA), parts[0], parts[2])
    assert default_settings(Choice("hold-disc")) == (PlanSetting(), PlanSetting("", GAMMA))


def names(*words: object, task: str = "overlap", methods: str | None = "raw,funnel", **more: float) -> list[str]:
    chosen = None if methods is None else parse_choices(methods)
    settings = parse_settings(",".join(map(str, words))) if words else None
    return [cell.id.name for cell in plan_alignment(Choice(task), chosen, settings, **more)]


def test_every_method_in_every_setting_after_the_formula_itself() -> None:
    """Whose cell does not depend on what else is planned."""
    assert names("recipe", "without=cuts gamma=1") == [
        "overlap/funnel/best-possible/0",
        "overlap/raw/planner/0",
        "overlap/funnel/planner/0",
        "overlap[without=cuts]/raw/planner[gamma=1]/0",
        "overlap[without=cuts]/funnel/planner[gamma=1]/0",
    ]
    assert {names(*words, methods="tau-mdp")[0] for words in ((), ("gamma=1",))} == {"overlap/funnel/best-possible/0"}


def test_where_actions_are_not_held_another_best_is_possible() -> None:
    cells = names("recipe", "without=hold", "without=cuts+hold", "without=cuts", methods="raw")
    best = ["overlap/funnel/best-possible/0", "overlap[without=hold]/funnel/best-possible/0"]
    assert (cells[:3], len(cells)) == ([*best, "overlap/raw/planner/0"], 2 + 4)


def test_the_resolution_is_every_agents_unless_a_setting_has_its_own() -> None:
    assert names("recipe", "gamma=1 resolution=2", methods="raw", resolution=0.6) == [
        "overlap/funnel/best-possible[resolution=0.6]/0",
        "overlap/raw/planner[resolution=0.6]/0",
        "overlap/raw/planner[gamma=1,resolution=2]/0",
    ]


def test_without_methods_all_that_fit() -> None:
    planned = {name.split("/")[1] for name in names("recipe", task="pendulum", methods=None)}
    assert {"flag", "funnel", "raw"} <= planned <= set(plugins.available("methods"))


NOT_PLANNED = "nothing can be planned on it: "


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"task": "overlaps"}, "no task 'overlaps'; did you mean 'overlap'?"),
        ({"task": "overlap", "methods": "raws"}, "no method 'raws'; did you mean 'raw'?"),
        ({"settings": "without=cut"}, "overlap[without=cut]: a task is never without 'cut', but perhaps without"),
        ({"settings": "without=exploring"}, "overlap[without=exploring]: the task is without exploring as it is"),
        ({"settings": "gama=1"}, "planner[gama=1]: no parameter 'gama'; did you mean 'gamma'?"),
        ({"settings": "gamma=x"}, "planner[gamma=x]: gamma should be a number, got 'x'"),
        ({"task": "overlap[without=cuts]"}, "overlap[without=cuts]: name the task alone, and give without=... as a"),
        ({"task": "lunar-lander"}, f"task lunar-lander: {NOT_PLANNED}a plan sets the state"),
        ({"task": "dwell"}, f"task dwell: {NOT_PLANNED}a state of 5 dimensions; a grid has at most 4"),
    ],
)
def test_what_is_wrong_is_one_line(words: dict[str, str], message: str) -> None:
    (task,) = parse_choices(words.get("task", "overlap"))
    settings = parse_settings(words.get("settings", "recipe"))
    with pytest.raises(UsageError) as caught:
        check_cells(plan_alignment(task, parse_choices(words.get("methods", "raw")), settings))
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_without_an_agent_that_plans_there_is_nothing_to_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "loadable", lambda kind: ({}, []))
    with pytest.raises(UsageError, match="no agent is installed that plans for a reward"):
        names("recipe")
