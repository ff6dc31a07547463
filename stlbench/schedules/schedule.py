"""The schedule of a formula: the alternative, the order and the times that ask for the least pace."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

import numpy as np

from stlbench import stl
from stlbench.contract import Array
from stlbench.schedules.plan import (
    MOST_PLANS,
    MOST_VISITS,
    Plan,
    UnscheduledError,
    conjunction,
    fewest_visits,
    plans,
)
from stlbench.schedules.regions import Regions
from stlbench.schedules.times import Programme, Times
from stlbench.schedules.witness import times_around
from stlbench.stl import Always, And, Eventually, Formula, Or, Term
from stlbench.stl.language.structure import negations_inside, operands_of


@dataclass(frozen=True)
class Schedule:
    """Terms of eq. 2 that together imply a formula."""

    terms: tuple[Term, ...]
    pace: float
    """Steps for each unit of distance that every way between two events has at least; the greater, the easier."""

    @property
    def formula(self) -> Formula:
        return conjunction(self.terms)


ALIKE = 0.9
"""Paces, or margins around witnesses, of at least this share of the greatest count as equal. The simplest schedule of
these is taken: a goal less is worth more than a little time."""
MOST_AROUND = 40
"""Alternatives into which witnesses are fitted. Each is a mixed-integer programme."""
MOST_NODES = 1500
"""Linear programmes that are solved for all alternatives of a formula, before the last one is begun. Hard formulas then
take seconds."""


def schedules(formula: Formula, regions: Regions, hold: int, last: int, share: float = 1.0) -> list[Schedule]:
    """The schedules of a formula, one for each alternative that has one, the best first.

    The best one has the fewest goals, then the fewest terms, then the greatest pace, among those whose pace is nearly
    the greatest. The others follow by their pace. Windows are as wide as they can be at this pace, or at a share of it.

    Raises:
        UnscheduledError: there is none.
    """
    found = list[Schedule]()
    try:
        timed = _timed(formula, regions, hold, last, share)
    except UnscheduledError:  # perhaps there are windows shorter than the time for which an action is held
        timed = _timed(formula, regions, 0, last, share)
    for plan, times in timed:
        if terms := plan.terms(times.values):
            found.append(Schedule(terms, times.pace))
    if not found and timed:
        raise UnscheduledError("every trace satisfies the formula")
    return list(dict.fromkeys(_best_first([(each.pace, each) for each in found], regions)))


def _best_first(graded: Sequence[tuple[float, Schedule]], regions: Regions) -> list[Schedule]:
    """The best first: those of nearly the greatest grade by goals, terms and grade, then the others by their grade."""
    enough = ALIKE * max(grade for grade, _ in graded)
    near = [each for each in graded if each[0] >= enough]
    near.sort(key=lambda each: (*_goals_and_terms(each[1], regions), -round(each[0], 6)))  # the solver's last digits
    rest = sorted((each for each in graded if each[0] < enough), key=lambda each: -each[0])
    return [schedule for _, schedule in near + rest]


def _goals_and_terms(schedule: Schedule, regions: Regions) -> tuple[int, int]:
    """How many goals and terms there are. A condition that is held for a while, not from the start on, is a goal."""
    terms = schedule.terms
    goals = [term for term in terms if term.kind != "G" or (term.a and regions.distance(None, term.psi))]
    held = sum(term.b - term.a for term in goals if term.kind == "G")
    return len(goals) + (held > 0), len(terms)


def around(formula: Formula, regions: Regions, hold: int, last: int, traces: Array) -> Schedule | None:
    """The schedule whose windows leave the most time after witnesses have met them; None where there is none.

    If several leave nearly as much, it has the fewest goals, then the fewest terms. A witness is left out if no
    windows serve it and those before it.

    Args:
        formula, regions, hold, last: as for `schedules`.
        traces: samples (n, last + 1, k) of the signals of `regions` that satisfy the formula.

    Raises:
        UnscheduledError: as `schedules`.
    """
    programmes = cache(lambda width: _programmes(formula, regions, width, last)[:MOST_AROUND])
    kept, best = traces[:0], None
    for trace in traces:
        more = np.concatenate([kept, trace[None]])
        tried = (_around(programmes(width), regions, more) for width in (hold, 0))  # as in `schedules`
        schedule = next(filter(None, tried), None)
        kept, best = (kept, best) if schedule is None else (more, schedule)
    return best


def _around(programmes: Sequence[Programme], regions: Regions, traces: Array) -> Schedule | None:
    found = list[tuple[float, Schedule]]()
    for programme in programmes:
        fitted = times_around(programme, traces, tuple(regions.box))
        if fitted is not None and (terms := programme.plan.terms(fitted[1].values)):
            found.append((fitted[0], Schedule(terms, fitted[1].pace)))
    return _best_first(found, regions)[0] if found else None


def _programmes(formula: Formula, regions: Regions, hold: int, last: int) -> list[Programme]:
    """The programmes of alternatives with possible events. Raises `UnscheduledError` where there are none."""
    found_plans = plans(formula, last)
    possible = [plan for plan in found_plans if all(regions.possible(event.psi) for event in plan.events)]
    if not found_plans:
        raise UnscheduledError(f"it never holds, or F inside of G takes more than {MOST_VISITS} visits")
    if not possible:
        psi = next(event.psi for event in found_plans[0].events if not regions.possible(event.psi))
        raise UnscheduledError(f"{psi} holds nowhere within the ranges of the signals")
    return [Programme(plan, regions, hold) for plan in possible]


def _timed(formula: Formula, regions: Regions, hold: int, last: int, share: float) -> list[tuple[Plan, Times]]:
    """The alternatives that have times. The search begins with those that may be fastest, and may end before all."""
    programmes = _programmes(formula, regions, hold, last)
    bounds = [(bound, place) for place, each in enumerate(programmes) if (bound := each.bound) is not None]
    if not bounds:
        raise UnscheduledError(f"its windows do not fit into the steps 0 to {last}, or leave each other no room")
    nodes, found = 0, dict[int, Times]()
    for _, place in sorted(bounds, key=lambda each: -each[0]):
        if nodes < MOST_NODES and (times := programmes[place].best(share)) is not None:
            found[place] = times
        nodes += programmes[place].nodes
    if not found:
        ways = "each alternative" if len(programmes) < MOST_PLANS else f"each of the first {MOST_PLANS} alternatives"
        reason = next(filter(None, (programmes[place].shortfall() for _, place in bounds)), "so in every order tried")
        raise UnscheduledError(f"in {ways} windows exclude each other: {reason}")
    return [(programmes[place].plan, found[place]) for place in sorted(found)]


def pursued(terms: Sequence[Term], regions: Regions) -> tuple[Term, ...]:
    """The terms without those that a robot could keep by waiting alone, before a goal whose condition they exclude.

    For G[0,20] !A & F[21,50] A it is F[0,50] A. A robot pursues A from step 0, and no cost stands where its goal is.
    The result is weaker: a robot that is at A too early satisfies it. The times are such that it need not be
    (`Programme`).
    """
    goals = [term for term in terms if term.kind != "G"]
    kept = list(terms)
    for goal in goals:
        before = max((other.end for other in goals if other is not goal and other.end <= goal.start), default=0)
        waits = [
            held
            for held in terms
            if held.kind == "G" and before <= held.a and held.b < goal.start and regions.exclusive(held.psi, goal.psi)
        ]
        if waits:
            kept = [replace(goal, a=before) if term is goal else term for term in kept if term not in waits]
    return tuple(kept)


def is_schedule(formula: Formula, regions: Regions) -> bool:
    """Whether it is one already: terms of eq. 2, and goals that exclude each other have windows that do not overlap."""
    try:
        terms = stl.fragment(formula)
    except stl.FragmentError:
        return False
    goals = [term for term in terms if term.kind != "G"]
    return not any(
        first.start < second.end and second.start < first.end and regions.exclusive(first.psi, second.psi)
        for first, second in combinations(goals, 2)
    )


def held(formula: Formula) -> Formula:
    """The formula with G[d,d] p in place of each F[c,d] p inside G that takes more than `MOST_VISITS` visits.

    It implies the formula, which stays as it is if there is no such F.
    """
    inside = negations_inside(formula)
    found = _held(inside, 0)
    return formula if found == inside else found


def _held(formula: Formula, span: int) -> Formula:
    match formula:
        case Eventually(a, b, arg) if fewest_visits(span, b - a) > MOST_VISITS:
            return Always(b, b, _held(arg, span))
        case Always(a, b):
            span += b - a
        case Eventually():
            span = 0
        case And() | Or():
            pass
        case _:
            return formula
    return formula.with_operands([_held(operand, span) for operand in operands_of(formula)])
