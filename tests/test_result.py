"""The identity of a cell: its name and its parts, and results as JSON."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from helpers.synthetic_results import result
from hypothesis import given
from hypothesis import strategies as st

from stlbench.errors import UsageError
from stlbench.registry.choices import Choice
from stlbench.result import ACCIDENTS, CellId, Planned, Setting, accidents_of, find_cell, from_json, to_json

CELL = CellId(
    Choice("overlap", (("without", "cuts"),)), Choice("funnel", (("ginf", "0.02"),)), Choice("dqn"), 3, "smoke"
)
NAME = "overlap[without=cuts]/funnel[ginf=0.02]/dqn/3"


def test_a_name_and_back():
    assert CELL.name == NAME
    assert CellId.parse(NAME, "smoke") == CELL
    assert CellId.parse("a/b[y=2,x=1]/c/0", "smoke") == CellId.parse("a/b[x=1, y=2]/c/0", "smoke")


words = st.from_regex(r"[a-z0-9][a-z0-9-]{0,8}", fullmatch=True)
values = st.from_regex(r"[A-Za-z0-9._+-]{1,6}", fullmatch=True)
choices = st.builds(
    lambda name, parameters: Choice(name, tuple(parameters.items())),
    words,
    st.dictionaries(st.from_regex(r"[a-z_][a-z0-9_]{0,5}", fullmatch=True), values, max_size=3),
)


@given(st.builds(CellId, choices, choices, choices, st.integers(0, 10_000), words))
def test_any_identity_comes_back_from_its_name_and_from_json(cell):
    assert CellId.parse(cell.name, cell.budget) == cell
    assert from_json(to_json(replace(result(), id=cell))).id == cell


def test_the_setting_is_all_but_the_seed():
    assert CELL.setting == Setting(CELL.task, CELL.method, CELL.agent, "smoke") == replace(CELL, seed=9).setting
    assert CELL.setting.name == "overlap[without=cuts]/funnel[ginf=0.02]/dqn"


def test_cells_are_ordered_by_task_method_agent_and_seed_as_a_number():
    names = ["a/b/c/2", "a/b/c/10", "a/b[x=1]/c/0", "a/b-c/c/0", "b/a/c/0"]
    cells = [CellId.parse(name, "smoke") for name in names]
    assert sorted(reversed(cells)) == cells


@pytest.mark.parametrize("name", ["", "a/b/c", "a/b/c/0/1", "a/b/c/-1", "a/b/c/x", "a//c/0", "a/b[x/c/0"])
def test_what_is_no_name_is_refused(name):
    with pytest.raises(UsageError):
        CellId.parse(name, "smoke")


def test_a_cell_is_found_by_name_however_it_is_written_and_by_budget_where_there_are_several():
    one, other, third = CELL, replace(CELL, budget="paper"), replace(CELL, seed=4)
    assert find_cell([one, third], NAME) == one
    assert find_cell([one, other, third], NAME, "paper") == other
    assert find_cell([one], "overlap[without=cuts]/funnel[ ginf=0.02 ]/dqn/3") == one
    with pytest.raises(UsageError, match="has the budgets paper, smoke; say which"):
        find_cell([one, other], NAME)
    with pytest.raises(UsageError, match="has no budget 'papers'; did you mean 'paper'"):
        find_cell([one, other], NAME, "papers")
    with pytest.raises(UsageError, match="no cell 'overlap/funnel/dqn/3'; did you mean 'overlap"):
        find_cell([one], "overlap/funnel/dqn/3")
    with pytest.raises(UsageError, match="names no cell; a name is task/method/agent/seed"):
        find_cell([one], "overlap")


def test_json_has_the_parts_of_the_identity_beside_the_rest_as_it_always_had():
    content = json.loads(to_json(result("funnel[b=2,a=1]", 3, robustness=(float("inf"), 0.5))))
    identity = {"task": "hold-disc", "method": "funnel[a=1,b=2]", "agent": "dqn", "seed": 3, "budget": "quick"}
    assert identity.items() <= content.items()
    assert content["measurement"]["selected"]["formula"]["robustness"] == [float("inf"), 0.5]
    assert from_json(json.dumps(content)) == result("funnel[b=2,a=1]", 3, robustness=(float("inf"), 0.5)) != result()


def test_a_record_whose_curve_does_not_say_its_starts_is_read():
    content = json.loads(to_json(result()))
    points = content["measurement"]["curve"]
    assert [point.pop("starts") for point in points] == [None, 64]
    read = from_json(json.dumps(content)).measurement
    assert read is not None
    assert [point.starts for point in read.curve] == [None, None]


@pytest.mark.parametrize("value", [0.25, -math.inf, math.nan])
def test_what_a_plan_expects_comes_back_also_where_it_is_no_number(value):
    read = from_json(to_json(result(planned=Planned("formula", value)))).measurement.planned
    assert read.maximised == "formula"
    assert repr(read.value) == repr(value)


def test_a_record_of_before_there_were_plans_is_of_a_learned_policy():
    content = json.loads(to_json(result()))
    assert content["measurement"].pop("planned") is None
    assert from_json(json.dumps(content)) == result()


@pytest.mark.parametrize("text", ["", "[]", "{}", "null", to_json(result()).replace('"seed": 0', '"seed": "x"')])
def test_other_json_is_refused(text):
    with pytest.raises(ValueError):  # noqa: PT011
        from_json(text)


def test_failures_to_try_again() -> None:
    assert accidents_of("failed") == accidents_of(True) == accidents_of(["failed", "timeout"]) == ACCIDENTS
    assert accidents_of("killed, raised") == ("raised", "killed")
    assert accidents_of(None) == accidents_of(False) == ()
    with pytest.raises(UsageError, match="no failure 'kiled'; did you mean 'killed'"):
        accidents_of("kiled")
    with pytest.raises(UsageError, match="no failure 'done'"):
        accidents_of("done,killed")
