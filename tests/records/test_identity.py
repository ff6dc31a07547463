"""The identity of a cell: its name, its parts, and how it is found."""

from __future__ import annotations

from dataclasses import replace

import pytest
from helpers.synthetic_results import result
from hypothesis import given, settings
from hypothesis import strategies as st

from stlbench.errors import UsageError
from stlbench.records.identity import CellId, Setting, find_cell
from stlbench.records.result import from_json, to_json
from stlbench.registry.choices import Choice

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


@settings(max_examples=25)
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


def test_a_cell_is_found_by_name_and_by_budget_where_there_are_several():
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


@pytest.mark.parametrize("digits", ["1" * 20, "9" * 5000])
def test_a_seed_that_is_too_long_is_one_line(digits):
    with pytest.raises(UsageError, match="names no cell") as caught:
        CellId.parse(f"a/b/c/{digits}", "smoke")
    assert len(str(caught.value)) < 1000
