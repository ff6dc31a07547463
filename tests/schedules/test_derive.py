"""From a formula to plans, by hand: which terms, at which times, what these leave out, and what has no plan."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.schedule_checks import NAMES, all_traces, all_values, parsed, shown
from numpy.typing import NDArray

from stlbench import stl
from stlbench.schedules.plan import MOST_PLANS, MOST_VISITS, Plan, UnscheduledError, conjunction, plans
from stlbench.schedules.schedule import held


def _satisfying(plan: Plan, last: int) -> dict[str, NDArray[np.bool_]]:
    """The terms of a plan at all times, and which traces of two signals satisfy them."""
    traces = all_traces(2, last + 1)
    found = {shown(terms): terms for values in all_values(plan, last) for terms in [plan.terms(values)]}
    return {
        text: stl.satisfied(conjunction(terms), traces, NAMES[:2]) if terms else np.ones(len(traces), dtype=bool)
        for text, terms in found.items()
    }


def _weakest(text: str, last: int) -> list[set[str]]:
    """Of each plan that has times, those terms that ask for least: no others hold where these do, and elsewhere."""
    found = list[set[str]]()
    for plan in plans(parsed(text), last):
        own = _satisfying(plan, last)
        weaker = {a: any((own[a] <= own[b]).all() and (own[a] < own[b]).any() for b in own) for a in own}
        found.append({each for each in own if not weaker[each]})
    return [each for each in found if each]


@pytest.mark.parametrize(
    ("text", "last", "expected"),
    [
        ("p", 3, [{"G[0,0] p"}]),
        ("G[1,3] p", 3, [{"G[1,3] p"}]),
        ("F[1,2] p", 2, [{"F[1,2] p"}]),
        ("F[0,9] p", 1, [{"F[0,1] p"}]),  # the episode ends before the interval does
        ("F[0,1] G[1,2] p", 3, [{"F[1,2] G[0,1] p"}]),
        ("G[1,2] G[0,3] p", 5, [{"G[1,5] p"}]),
        ("F[1,1] F[0,1] p", 2, [{"F[1,2] p"}]),
        ("!(F[0,1] p or G[0,1] q)", 1, [{"F[0,1] !q & G[0,1] !p"}]),
        ("F[0,1] p -> G[0,1] q", 1, [{"G[0,1] !p"}, {"G[0,1] q"}]),
        # one visit for all steps, or one after the other, or p at the last step of each interval
        ("G[0,1] F[1,2] p", 3, [{"F[2,2] p"}, {"F[1,1] p & F[2,3] p", "F[1,2] p & F[3,3] p"}, {"G[2,3] p"}]),
        ("p U[1,1] q", 1, [{"F[1,1] q & G[0,0] p"}]),
        ("p U[0,1] q", 1, [{"F[0,0] q", "F[0,1] q & G[0,0] p"}, {"F[0,1] q & G[0,0] (p | q)"}]),
        (
            "p U[0,1] q & q",
            0,
            [{"F[0,0] q & G[0,0] q"}, {"F[0,0] q & G[0,0] (p | q) & G[0,0] q", "F[0,0] q & G[0,0] q"}],
        ),
        # q all the time, or until p holds
        ("p R[0,1] q", 1, [{"G[0,1] q"}, {"F[0,0] p & G[0,0] q", "F[0,1] p & G[0,1] q"}]),
        (
            "F[0,1] (p & F[1,1] q)",
            2,
            [
                {"F[0,0] p & F[1,1] q", "F[1,1] p & F[2,2] q"},
                {"F[0,0] p & G[1,1] q", "F[0,1] p & G[1,2] q", "F[1,1] p & G[2,2] q"},
            ],
        ),
        # p before q, p inside of a window, q before p, q inside of a window
        (
            "G[0,1] (q or G[0,0] p)",
            1,
            [
                {"G[0,1] q"},
                {"G[0,1] p"},
                {"G[0,1] q", "G[0,0] p & G[1,1] q", "G[0,1] p"},
                {"G[0,0] p & G[1,1] q", "G[0,1] p", "G[0,0] q & G[1,1] p"},
                {"G[0,1] q", "G[0,0] q & G[1,1] p", "G[0,1] p"},
                {"G[0,1] q", "G[0,0] p & G[1,1] q", "G[0,0] q & G[1,1] p"},
            ],
        ),
        ("H[0,1] p", 1, [{"G[0,0] p"}]),
        ("H[1,2] p", 1, [{""}]),  # there is no sample before step 0
        (
            "G[1,1] H[0,3] F[0,2] p",
            3,
            [{"F[1,2] p"}, {f"F[0,{k}] p & F[{k + 1},3] p" for k in (0, 1, 2)}, {"G[2,3] p"}],
        ),
        ("O p", 1, [{"F[0,0] p"}]),
        ("O[1,1] p", 1, []),
        ("F[1,2] O[1,1] p", 2, [{"F[0,1] p"}]),
        ("F[1,2] H[0,1] p", 2, [{"F[0,1] G[0,1] p"}]),
        ("F[3,4] H[1,2] p", 5, [{"F[1,2] G[0,1] p"}]),
        ("F[1,2] H p", 3, [{"G[0,1] p"}]),
        ("G[2,2] (p S[1,2] q)", 2, [{"F[0,1] q & G[1,2] p", "F[1,1] q & G[2,2] p"}]),
        ("True", 1, [{""}]),
        ("False", 1, []),
        ("F[0,1] False", 1, []),
        (
            "False U[0,2] q",
            2,
            [{"F[0,0] q"}, {"F[0,0] q", "F[0,0] q & G[0,0] (!True | q)", "F[0,1] q & G[0,0] (!True | q)"}],
        ),
        # the episode ends before it is decided
        ("G[0,3] p", 2, []),
        ("F[1,2] G[0,2] p", 3, [{"F[1,1] G[0,2] p"}]),
        # at step 0 there is no step before, from which F or G could look ahead to step 1
        ("O[1,1] F[2,2] p", 1, []),
        ("F[0,1] (q & O[1,1] G[1,1] p)", 1, [{"F[1,1] q & F[1,1] p"}, {"F[1,1] q & G[1,1] p"}]),
        ("O[2,2] True R[0,1] q", 1, [{"G[0,1] q"}]),
    ],
)
def test_by_hand(text: str, last: int, expected: list[set[str]]) -> None:
    assert _weakest(text, last) == expected


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("F p", "F without an interval at column 1 has no deadline; give it one, [a,b]"),
        ("F[0,3] (p & G q)", "G without an interval at column 20 has no deadline; give it one, [a,b]"),
        ("p R q", "R without an interval at column 10 has no deadline; give it one, [a,b]"),
    ],
)
def test_no_deadline(text: str, message: str) -> None:
    with pytest.raises(UnscheduledError) as raised:
        plans(parsed(text), 9)
    assert str(raised.value) == message


def test_past_without_an_interval_begins_at_step_0() -> None:
    rows = [row for plan in plans(parsed("F[1,3] (p & O q)"), 9) for row in plan.rows]
    assert max(abs(at.offset) for row in rows for at in row) < 10


def test_many_alternatives_are_cut() -> None:
    pairs = " & ".join(f"(F[0,{10 + k}] p or F[0,{10 + k}] q)" for k in range(20))
    assert len(plans(parsed(pairs), 99)) == MOST_PLANS


def test_many_visits_are_left_out() -> None:
    assert plans(parsed("G[0,985] F[0,15] p"), 1000) == ()
    visits = {len(plan.events) for plan in plans(parsed("G[0,189] F[0,15] p"), 204)}
    assert max(visits) == MOST_VISITS


@pytest.mark.parametrize(
    ("text", "stronger"),
    [
        ("G[0,985] F[0,15] p", "G[0,985] G[15,15] p"),
        ("G[0,985] (q & F[3,15] p)", "G[0,985] (q & G[15,15] p)"),
        ("G[0,100] G[0,100] F[0,9] p", "G[0,100] G[0,100] G[9,9] p"),
        ("!(F[0,985] G[0,15] p)", "G[0,985] G[15,15] !p"),
        ("q | F[0,9] G[0,985] F[0,15] p", "q | F[0,9] G[0,985] G[15,15] p"),
        ("G[0,985] F[0,200] F[0,2] p", "G[0,985] F[0,200] F[0,2] p"),
        ("G[0,189] F[0,15] p", "G[0,189] F[0,15] p"),
        ("q -> G[0,985] p", "q -> G[0,985] p"),
    ],
)
def test_what_takes_too_many_visits_may_be_held(text: str, stronger: str) -> None:
    formula, found = parsed(text), held(parsed(text))
    assert found == parsed(stronger) or str(found) == str(parsed(stronger))
    walks = np.random.default_rng(0).choice([-1.0, 1.0], (100, 1200, 2), p=[0.01, 0.99])
    kept = stl.satisfied(found, walks, ["p", "q"])
    assert stl.satisfied(formula, walks[kept], ["p", "q"]).all()


def test_alternatives_that_contradict_themselves_are_left_out() -> None:
    """`xor` repeats its operands: of six goals, an odd number is reached, and the others are not, in 32 ways."""
    text = " xor ".join(f"F[0,9] s{i} >= 0" for i in range(6))
    found = plans(stl.parse(text), 9)
    reached = {frozenset(str(event.psi) for event in plan.events) for plan in found}
    assert len(found) == len(reached) == 32
    assert all(len(plan.events) % 2 == 1 and len(plan.events) + len(plan.held) == 6 for plan in found)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("F[0,9] p & F[0,9] p", 1),  # the same again
        ("F[0,9] p & F[0,8] p", 2),
        ("F[1,8] p & G[0,9] !p", 0),
        ("G[0,9] !p & F[0,9] p", 0),
        ("F[0,9] p & G[0,8] !p", 1),  # step 9 is left
        ("F[0,6] G[0,3] p & G[0,9] !p", 0),
    ],
)
def test_what_was_asked_for_before_is_not_asked_for_again(text: str, expected: int) -> None:
    """The events of the only alternative; 0 where there is none."""
    assert [len(plan.events) for plan in plans(parsed(text), 9)] == ([expected] if expected else [])
