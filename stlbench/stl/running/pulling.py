"""F[a,b] psi as a disjunction of F whose operands look back instead of ahead, so that one pass decides them.

The last sample that makes psi hold is the moment at which it is known. So `F (p & F q)` is `F (q & O p)`: q, after p.
With an interval, `F[0,9] (p & F[0,3] q)` is `F[0,12] (q & O[0,3] (p & During(0,9)))`.
Values, bounds of all prefixes and verdicts stay the same, which holds on each trace that goes on for ever.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from stlbench.stl.language.structure import lookahead, negations_inside, walk
from stlbench.stl.language.syntax import (
    END,
    Always,
    And,
    Eventually,
    Formula,
    Historically,
    Not,
    Once,
    Or,
    Release,
    Since,
    TrueFormula,
    Until,
)

#: orders of that many events are written out: 3 in a row may come in 6 orders
EVENTS = 3
#: disjuncts beyond which a formula is left as it is
TERMS = 16


@dataclass(frozen=True)
class During(TrueFormula):
    """Steps `first`..`last`: inf there, -inf at others."""

    first: int
    last: int


class Goal(NamedTuple):
    """F[start,stop] psi, psi in negation normal form."""

    start: int
    stop: int
    psi: Formula


class AsUntil(NamedTuple):
    """`left U[a,b] right`, or its `opposite`."""

    opposite: bool
    a: int
    b: int
    left: Formula
    right: Formula


def as_until(formula: Formula) -> AsUntil:
    """F q is True U q, G q is !(True U !q), p R q is !(!p U !q); any other formula is F[0,0] of it."""
    match formula:
        case Until(a, b, left, right):
            return AsUntil(False, a, b, left, right)
        case Release(a, b, left, right):
            return AsUntil(True, a, b, Not(left), Not(right))
        case Eventually(a, b, arg):
            return AsUntil(False, a, b, TrueFormula(), arg)
        case Always(a, b, arg):
            return AsUntil(True, a, b, TrueFormula(), Not(arg))
        case _:
            return AsUntil(False, 0, 0, TrueFormula(), formula)


def as_goal(until: AsUntil) -> Goal:
    """An until at step 0 as F: where right holds, left has held so far at the step before."""
    goal = conjuncts(negations_inside(until.right))
    if until.left == TrueFormula() or until.b == 0:
        return Goal(until.a, until.b, all_of(goal))
    so_far = Historically(0, END, negations_inside(until.left))
    return Goal(until.a, until.b, all_of([*goal, Historically(1, 1, so_far)]))


def terms(goal: Goal) -> list[Goal]:
    """A goal as a disjunction; as it is where no rule helps."""
    found = _terms(*goal)
    return found if len(found) <= TERMS else [goal]


def _terms(start: int, stop: int, psi: Formula) -> list[Goal]:
    match psi:
        case Or(args):
            return [term for arg in args for term in _terms(start, stop, arg)]
        case Eventually(a, b, arg):
            return _terms(start + a, later(stop, b), arg)
        case Always(a, b, Always(c, d, arg)) if END not in (b, d):
            return _terms(start, stop, Always(a + c, b + d, arg))
        case Always(a, b, Eventually(c, d, arg)) if stop == END > b:
            # Known first for the window that ends now: its last F by this sample, the others by their own windows.
            closed = (b - a) - (d - c)
            earlier = [Historically(0, closed, Once(0, d - c, arg))] if d < END and closed > 0 else []
            return [Goal(start + b + c, END, all_of([arg, *earlier]))]
        case Until(0, 0, _, arg) | Release(0, 0, _, arg):
            return _terms(start, stop, arg)
        case And() | Until() | Release():
            return _conjunction(start, stop, conjuncts(psi))
        case _:
            return [Goal(start, stop, psi)]


def _conjunction(start: int, stop: int, args: Sequence[Formula]) -> list[Goal]:
    """F of a conjunction."""
    for choice in args:
        if isinstance(choice, Or) and any(_looks_ahead(each) for each in choice.args):
            others = [arg for arg in args if arg is not choice]
            return [term for each in choice.args for term in _terms(start, stop, all_of([*others, each]))]
    events = [arg for arg in args if isinstance(arg, Eventually | Until | Release)]
    now = rest = [arg for arg in args if not isinstance(arg, Eventually | Until | Release)]
    if (start, stop) != (0, END):
        now = [*rest, During(start, stop)]
    match events:
        case [Release(a, b, left, right)] if a > 0:
            ways = Eventually(0, a - 1, left), Eventually(a, a, Release(0, b - a, left, right))
            return [term for each in ways for term in _terms(start, stop, all_of([*rest, each]))]
        case [Eventually(a, b, goal)]:
            before = [Once(a, b, all_of(now))] if now else []
            return _terms(start + a, later(stop, b), all_of([*conjuncts(goal), *before]))
        case [Until(a, b, left, goal)] if b > 0:
            if a == 0 and not now:
                return _terms(0, END, goal)
            begun = Once(1, 1, Since(max(0, a - 1), _before(b), left, all_of([*now, left])))
            way = begun if a > 0 else Or((all_of(now), begun))
            return _terms(start + a, later(stop, b), all_of([*conjuncts(goal), way]))
        case [Release(0, b, left, right)] if b > 0:
            released = all_of([*conjuncts(left), Since(0, _before(b), right, all_of([*now, right]))])
            held = Goal(start, stop, all_of([*rest, Always(0, b, right)]))
            return [*_terms(start, later(stop, _before(b)), released), held]
        case [_, _, *_] if len(events) <= EVENTS and all(
            isinstance(each, Eventually) and (each.a, each.b) == (0, END) for each in events
        ):
            goals = [each.arg for each in events if isinstance(each, Eventually)]
            return [term for last in orders(now, goals) for term in _terms(start, END, last)]
        case _:
            return [Goal(start, stop, all_of(args))]


def later(step: int, more: int) -> int:
    """A step and some more, or `END`."""
    return END if END in (step, more) else step + more


def _before(step: int) -> int:
    return step - (step < END)


def orders(rest: Sequence[Formula], goals: Sequence[Formula]) -> list[Formula]:
    """All goals, each at or after `rest`, by which of them comes last."""
    last = []
    for i, goal in enumerate(goals):
        others = [*goals[:i], *goals[i + 1 :]]
        before = orders(rest, others) if others else [all_of(rest)] if rest else []
        past = [Once(0, END, before[0] if len(before) == 1 else Or(tuple(before)))] if before else []
        last.append(all_of([*conjuncts(goal), *past]))
    return last


def conjuncts(formula: Formula) -> Sequence[Formula]:
    return formula.args if isinstance(formula, And) else (formula,)


def all_of(parts: Sequence[Formula]) -> Formula:
    return And(tuple(parts)) if len(parts) > 1 else parts[0]


def _looks_ahead(formula: Formula) -> bool:
    return lookahead(formula) > 0 or any(
        isinstance(node, Eventually | Until | Release | Always) for node in walk(formula)
    )
