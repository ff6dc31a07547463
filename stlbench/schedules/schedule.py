"""The schedule of a formula: the alternative, the order and the times that ask for the least pace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

from stlbench import stl
from stlbench.schedules.derive import UnscheduledError, plans
from stlbench.schedules.plan import conjunction
from stlbench.schedules.regions import Regions
from stlbench.schedules.times import Programme
from stlbench.stl import Formula, Term


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
"""Paces of at least this share of the greatest count as equal. The simplest schedule of these is taken."""


def schedules(formula: Formula, regions: Regions, hold: int, last: int) -> list[Schedule]:
    """The schedules of a formula, one for each alternative that has one, the best first.

    The best one has the fewest goals, then the fewest terms, then the greatest pace, among those whose pace is nearly
    the greatest. The others follow by their pace.

    Raises:
        UnscheduledError: there is none.
    """
    found = list[tuple[Schedule, tuple[int, int, float]]]()
    for plan in plans(formula, last):
        times = Programme(plan, regions, hold).best()
        if times is not None and (terms := plan.terms(times.values)):
            goals = [term for term in terms if term.kind != "G" or (term.a and regions.distance(None, term.psi))]
            held = sum(term.b - term.a for term in goals if term.kind == "G")
            schedule = Schedule(terms, times.pace)
            found.append((schedule, (len(goals) + (held > 0), len(terms), -round(times.pace, 6))))
    if not found:
        raise UnscheduledError("the windows exclude each other in every order")
    most = max(schedule.pace for schedule, _ in found)
    found.sort(
        key=lambda each: (each[0].pace < ALIKE * most, each[1] if each[0].pace >= ALIKE * most else (-each[0].pace,))
    )
    return list(dict.fromkeys(schedule for schedule, _ in found))


def pursued(terms: Sequence[Term], regions: Regions) -> tuple[Term, ...]:
    """The terms, with goals that begin when the goal before them ends although their condition is excluded until later.

    A method pursues a term from the last end of a term before its begin. Of G[0,90] !A & F[91,100] A it would begin
    with A at step 90. With F[0,100] A in place of F[91,100] A it begins at once. The same traces satisfy both, but for
    those that touch A at its border alone.
    """
    goals = [term for term in terms if term.kind != "G"]

    def earlier(term: Term) -> Term:
        before = max((goal.end for goal in goals if goal is not term and goal.end <= term.start), default=0)
        excluded = any(
            held.kind == "G"
            and held.a <= before + 1
            and before < held.b == term.start - 1
            and regions.exclusive(held.psi, term.psi)
            for held in terms
        )
        return replace(term, a=before) if excluded else term

    return tuple(earlier(term) if term in goals else term for term in terms)


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
