"""The formulas of a training on the track `auto`, from the task's own to the one that methods are given."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.line_task import line

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.registry.choices import Choice
from stlbench.schedules.plan import UnscheduledError, conjunction
from stlbench.schedules.schedule import pursued
from stlbench.simulation.referee import Referee
from stlbench.study.cell import on_track
from stlbench.task import Task, build_method, load_task
from stlbench.task.build import as_given
from stlbench.task.forms import normal_form
from stlbench.tracks.auto import alternatives, initial_samples, regions, rewarded, scheduled

NESTED = {
    "chain": "F[0,4] (x >= 5 & F[0,4] x <= -5)",
    "again and again": "G[0,2] (F[0,6] x >= 5 & F[0,6] x <= -5)",
    "response": "F[0,3] x >= 5 & G[0,3] (x >= 5 -> F[0,4] x <= -5)",
    "until": "x >= -5 U[2,4] x >= 5",
    "in any order": "F[0,8] x >= 5 & F[0,8] x <= -5",
}
OWN = ["F[0,4] x >= 5 & F[4,8] x <= -5", "G[0,8] x <= 5", "F[0,4] (G[0,2] x >= 5 | G[0,2] x <= -5)"]


def helped(task: Task) -> Task:
    return on_track(task, Choice("dqn"), "auto")


@pytest.mark.parametrize("formula", NESTED.values(), ids=NESTED)
def test_every_method_of_terms_takes_a_nested_formula(formula: str) -> None:
    task = helped(line(formula=formula))
    assert task.file.schedule == scheduled(line(formula=formula))
    assert task.file.nested is None
    for method in ("raw", "funnel", "flag", "cfer", "machine"):
        assert build_method(task, method).specification.formula == task.file.rewarded


@pytest.mark.parametrize("formula", NESTED.values(), ids=NESTED)
def test_what_satisfies_the_schedule_satisfies_the_formula(formula: str) -> None:
    """Of 20,000 random walks, those that satisfy the schedule; and some do."""
    schedule = scheduled(line(formula=formula))
    assert schedule is not None
    walks = np.random.default_rng(0).choice([-9.0, -5.0, 0.0, 5.0, 9.0], (20_000, 9, 1))
    kept = walks[stl.satisfied(schedule, walks, ["x"])]
    assert len(kept) > 50
    assert stl.satisfied(stl.parse(formula), kept, ["x"]).all()


@pytest.mark.parametrize("parameters", [(), (("without", "rewarded"),)])
def test_methods_that_do_not_take_many_visits_are_given_a_form_that_is_held(parameters: Any) -> None:
    """Flags take the formula itself. The other form asks for more: x at the last step of each window."""
    text = "G[0,28] (F[0,1] x >= -5 & G[0,0] x >= -6)"
    own = replace(line(formula=text, steps=29), choice=Choice("line", parameters))
    task = helped(own)
    assert scheduled(own) is None
    walks = np.random.default_rng(0).choice([-6.0, -5.0, 0.0], (5_000, 30, 1), p=[0.02, 0.49, 0.49])
    formula, held = stl.parse(text), stl.parse("G[1,29] x >= -5 & G[0,28] x >= -6")
    for methods, asked in ((("flag", "tau-mdp", "bhnr"), formula), (("raw", "funnel"), held)):
        for method in methods:
            given = build_method(task, method).specification
            assert given.nested is None
            kept = stl.satisfied(given.formula, walks, ["x"])
            assert (kept == stl.satisfied(asked, walks, ["x"])).all()
            assert kept.any()
            assert not kept.all()


def test_a_key_has_the_other_form_only_if_the_method_takes_it() -> None:
    task = helped(line(formula="G[0,28] (F[0,1] x >= -5 & G[0,0] x >= -6)", steps=29))
    assert task.otherwise is not None
    for method, kept in (("flag", None), ("bhnr", None), ("raw", task.otherwise), ("funnel", task.otherwise)):
        assert as_given(task, Choice(method)).otherwise == kept


def test_without_its_schedule_a_formula_has_no_form_that_is_held() -> None:
    task = replace(line(formula="G[0,28] F[0,1] x >= -5", steps=29), choice=Choice("line", (("without", "schedule"),)))
    assert task.otherwise is None


@pytest.mark.parametrize("formula", OWN)
def test_a_formula_that_has_its_windows_stays_as_it_is(formula: str) -> None:
    assert alternatives(line(formula=formula)) == ()
    assert helped(line(formula=formula)).file.schedule is None


def test_each_form_relates_to_the_one_before_as_it_should() -> None:
    """The schedule asks for more, conditions that waiting satisfies are left out, and the scale changes no verdict."""
    task = line(formula=NESTED["response"])
    file = helped(task).file
    assert file.schedule is not None
    begins = conjunction(pursued(stl.fragment(file.schedule), regions(task)))
    forms = [task.formula, file.schedule, begins, normal_form(begins), rewarded(file, initial_samples(task))]
    assert forms[-1] == file.rewarded
    walks = np.random.default_rng(0).choice([-9.0, -5.0, 0.0, 5.0, 9.0], (5_000, 9, 1))
    own, schedule, begun, form, scale = (stl.satisfied(each, walks, ["x"]) for each in forms)
    assert (schedule <= own).all()
    assert (schedule <= begun).all()
    assert (begun <= form).all()
    assert (scale == form).all()


def test_the_referee_and_the_selection_know_the_own_formula_alone() -> None:
    """Standing at 6 satisfies the formula by its second part, though the schedule takes the first one."""
    task = helped(line(formula="F[0,4] (x >= -9 & F[0,4] x <= -5) | F[0,8] (x >= 5 & F[0,0] x >= 5)"))
    assert task.file.schedule is not None
    assert Referee(task, build_method(task, "raw"))._protocols["formula"][0] == task.formula


def test_a_schedule_can_be_left_out() -> None:
    task = load_task("suite-integrator-chain-0[without=schedule]")
    left = helped(task).file
    assert left.schedule is None
    assert left.rewarded != helped(load_task("suite-integrator-chain-0")).file.rewarded
    with pytest.raises(UsageError, match="the task is without schedule as it is on the track auto"):
        helped(load_task("suite-integrator-sequence-0[without=schedule]"))


def test_without_a_schedule_a_task_trains_as_before() -> None:
    task = line(formula="F[0,8] (x >= 5 & G[0,0] x <= -5)")
    with pytest.raises(UnscheduledError, match=r"exclude each other|leave each other no room"):
        alternatives(task)
    assert helped(task).file.schedule is None


def test_exploring_leaves_out_what_excludes_a_later_goal() -> None:
    exploring = helped(line(formula="x <= 4 U[2,4] x <= -5 & F[4,8] x >= 5 & G[0,8] x <= 9")).file.training.exploring
    assert exploring is not None
    assert exploring.states is not None
    assert str(exploring.states.where) == "x <= 9"
    assert [str(near.where) for near in exploring.near] == ["x <= -5", "x >= 5"]
