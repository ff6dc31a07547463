"""Schedules: of real tasks, of formulas on a line, and why there is none."""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import scipy.optimize
from helpers.schedule_checks import keeps, satisfying_trace

from stlbench import stl
from stlbench.schedules.plan import UnscheduledError, conjunction, plans
from stlbench.schedules.regions import Regions
from stlbench.schedules.schedule import is_schedule, pursued, schedules
from stlbench.schedules.times import Programme
from stlbench.stl import Formula, Predicate, Term
from stlbench.stl.language.structure import walk
from stlbench.task.task import Task, load_task
from stlbench.tracks.auto import alternatives, initial_samples, units

TEMPLATES = ("chain", "free-order", "overlap", "patrol", "patrol-stay", "response", "until")

#: a place on a line from 0 to 10, at which episodes start at 0
LINE = Regions({"x": (0.0, 10.0)}, {"x": "m"}, np.zeros((4, 1)))
NEAR, FAR = "x >= 2 & x <= 3", "x >= 6 & x <= 7"


def _with_letters(formula: Formula, letters: dict[Predicate, Formula]) -> Formula:
    """The formula with predicates of signals of their own, each of which may hold whatever the others do."""
    if isinstance(formula, Predicate):
        return letters[formula]
    inner = [_with_letters(each, letters) for each in formula.operands if isinstance(each, Formula)]
    return formula.with_operands(inner) if inner else formula


def _regions(task: Task) -> Regions:
    return Regions(task.file.box, units(task.file), initial_samples(task))


@pytest.mark.parametrize("template", TEMPLATES)
def test_schedules_of_a_task_imply_its_formula(template: str) -> None:
    task = load_task(f"suite-unicycle-{template}-0")
    formula, last = task.file.formula, task.file.steps
    predicates = [each for each in dict.fromkeys(walk(formula)) if isinstance(each, Predicate)]
    names = tuple(f"p{k}" for k in range(len(predicates)))
    letters = dict(zip(predicates, (stl.parse(f"{name} >= 0") for name in names), strict=True))
    generator = np.random.default_rng(0)
    found = alternatives(task)
    assert found
    for schedule in found:
        assert stl.fragment(schedule.formula) == schedule.terms
        assert max(term.end for term in schedule.terms) <= last
        terms = [replace(term, psi=_with_letters(term.psi, letters)) for term in schedule.terms]
        traces = [satisfying_trace(terms, last + 1, generator, names) for _ in range(10)]
        drawn = np.array([trace for trace in traces if trace is not None])
        assert len(drawn) == 10
        assert stl.satisfied(conjunction(terms), drawn, names).all()
        assert stl.satisfied(_with_letters(formula, letters), drawn, names).all()


@pytest.mark.parametrize("template", TEMPLATES)
def test_times_keep_the_rows(template: str) -> None:
    task = load_task(f"suite-unicycle-{template}-0")
    regions, hold, last = _regions(task), task.file.hold, task.file.steps
    timed = [(plan, Programme(plan, regions, hold).best()) for plan in plans(task.file.formula, last)]
    assert any(times is not None for _, times in timed)
    for plan, times in timed:
        if times is not None:
            assert keeps(plan, times.values)
            assert all(event.end.of(times.values) - event.begin.of(times.values) >= hold for event in plan.events)


@pytest.mark.parametrize("template", TEMPLATES)
def test_what_satisfies_a_schedule_satisfies_what_is_pursued(template: str) -> None:
    task = load_task(f"suite-unicycle-{template}-0")
    regions = _regions(task)
    for schedule in alternatives(task):
        for term in pursued(schedule.terms, regions):
            (own,) = (
                each for each in schedule.terms if (each.kind, each.end, each.psi) == (term.kind, term.end, term.psi)
            )
            assert term == own if term.kind == "G" else term.start <= own.start


def _best(text: str, hold: int = 1, last: int = 100) -> str:
    return str(schedules(stl.parse(text), LINE, hold, last)[0].formula)


def test_the_way_takes_the_time() -> None:
    """From 0 it is 2.5 to the first region and 2.5 to the second one, as far as points are deep enough inside."""
    (found,) = schedules(stl.parse(f"F[0,40] ({NEAR}) & F[0,80] ({FAR})"), LINE, 1, 100)
    first, second = found.terms
    assert (first.kind, first.a, second.b) == ("F", 0, 80)
    assert first.b <= second.a
    assert found.pace == pytest.approx(40 / 2.75, rel=0.2)


def test_order_follows_the_way() -> None:
    for text in (f"F[0,90] ({FAR}) & F[0,90] ({NEAR})", f"F[0,90] ({NEAR}) & F[0,90] ({FAR})"):
        (found,) = schedules(stl.parse(text), LINE, 1, 100)
        assert [str(term.psi) for term in found.terms] == [NEAR, FAR]


def test_windows_are_as_wide_as_an_action_is_held() -> None:
    for term in stl.fragment(stl.parse(_best(f"F[0,90] (({NEAR}) & F[0,90] ({FAR}))", hold=7))):
        assert term.b - term.a >= 7


def test_what_takes_too_many_visits_is_not_held_all_the_time() -> None:
    with pytest.raises(UnscheduledError, match="takes more than 12 visits"):
        _best("G[0,985] F[0,15] x >= 0.5", last=1000)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"F[200,300] ({NEAR})", "its windows do not fit into the steps 0 to 100"),
        ("False", "it never holds"),
        ("H[1,3] x >= 1", "every trace satisfies the formula"),
        (
            f"G[0,50] ({NEAR}) & F[10,20] ({FAR})",
            "windows exclude each other",
        ),
        ("F x >= 1", "F without an interval at column 1 has no deadline; give it one, [a,b]"),
    ],
)
def test_why_there_is_none(text: str, message: str) -> None:
    with pytest.raises(UnscheduledError) as raised:
        schedules(stl.parse(text), LINE, 5, 100)
    assert message in str(raised.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (f"F[0,9] ({NEAR}) & G[0,20] x >= 1", True),
        (f"F[0,9] ({NEAR}) & F[9,20] ({FAR})", True),
        (f"F[0,9] ({NEAR}) & F[5,20] ({FAR})", False),
        (f"F[0,9] ({NEAR}) & F[5,20] x >= 2.5", True),  # both hold at once
        (f"F[0,9] (({NEAR}) & F[0,9] ({FAR}))", False),
    ],
)
def test_what_is_a_schedule_already(text: str, expected: bool) -> None:
    assert is_schedule(stl.parse(text), LINE) is expected


def test_a_goal_is_pursued_before_it_is_allowed() -> None:
    terms = stl.fragment(stl.parse(f"F[0,20] ({FAR}) & F[51,90] ({NEAR}) & G[20,50] !({NEAR}) & G[0,90] x <= 9"))
    free = Term("F", 20, 90, 0, 0, stl.parse(NEAR))
    assert pursued(terms, LINE) == (terms[0], free, terms[3])


def test_a_hard_formula_has_an_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of many alternatives, those are searched that may be fastest."""
    text = " & ".join(f"(F[0,{60 + k}] x >= {k + 2} or F[0,{60 + k}] x <= {k + 0.5})" for k in range(5))
    everything = schedules(stl.parse(text), LINE, 1, 100)
    monkeypatch.setattr("stlbench.schedules.schedule.MOST_NODES", 20)
    few = schedules(stl.parse(text), LINE, 1, 100)
    assert few[0] == everything[0]
    assert 0 < len(few) < len(everything)


def test_an_order_that_is_not_searched_to_the_end_is_improved(monkeypatch: pytest.MonkeyPatch) -> None:
    """Places on a line in any order: the way along the line is the shortest, and the search has time for one order."""
    places = [f"x >= {k} & x <= {k + 0.5}" for k in (5, 2, 7, 1, 9, 3, 8)]
    text = " & ".join(f"F[0,95] ({place})" for place in places)
    monkeypatch.setattr("stlbench.schedules.times.MOST_NODES", 40)
    (found,) = schedules(stl.parse(text), LINE, 1, 100)
    assert [str(term.psi) for term in found.terms] == sorted(places)


@pytest.mark.parametrize("name", ["suite-cart-pendulum-patrol-stay-1", "suite-cart-pendulum-patrol-stay-2"])
def test_goals_that_exclude_each_other_have_windows_apart(name: str) -> None:
    """Also where the fastest times had them apart without a decision: wider windows overlapped there."""
    (schedule,) = alternatives(load_task(name))[:1]
    goals = [term for term in schedule.terms if term.kind != "G"]
    for first, second in combinations(sorted(goals, key=lambda term: term.end), 2):
        assert first.psi == second.psi or first.end <= second.start


@pytest.mark.parametrize("name", ["integrator-chain-1", "pair-chain-2", "quadrotor-response-3", "arm-overlap-1"])
def test_windows_do_not_depend_on_the_solver(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """An interior point has other steps than the simplex method, where several cost the same."""
    task, solve, found = load_task(f"suite-{name}"), scipy.optimize.linprog, []
    for other in ("highs-ds", "highs-ipm"):
        monkeypatch.setattr(
            scipy.optimize, "linprog", lambda *args, other=other, **given: solve(*args, **given | {"method": other})
        )
        found.append(schedules(task.file.formula, _regions(task), task.file.hold, task.file.steps)[0].formula)
    assert found[0] == found[1]


def test_windows_at_a_share_of_the_pace_are_wide_and_in_the_middle() -> None:
    """From 0 to A at 1 and then to B at -1: at most 30 steps from the begin of A's window to the end of B's.

    B needs half of these, so A's window has the other half. It may begin at 0 to 15 or so.
    """
    formula, regions = stl.parse("F[0,30] (x >= 1 & F[0,30] x <= -1)"), Regions({"x": (-1, 1)}, {}, np.zeros((1, 1)))
    (narrow, *_), (wide, *_) = (schedules(formula, regions, 1, 60, share) for share in (1.0, 0.5))
    assert [(term.start, term.end) for term in narrow.terms] == [(13, 14), (14, 43)]
    ends = [end for term in wide.terms for end in (term.start, term.end)]
    assert ends == pytest.approx([7, 22, 22, 37], abs=1)
    assert wide.pace == narrow.pace  # of the narrow windows, by which alternatives are compared
