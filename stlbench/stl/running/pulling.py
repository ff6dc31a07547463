"""F[a,b] psi as a disjunction of F whose operands look back instead of ahead, so that one pass decides them.

The last sample that makes psi hold is the moment at which it is known. So `F (p & F q)` is `F (q & O p)`: q, after p.
Values, bounds of all prefixes and verdicts stay the same, which holds on each trace that goes on for ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from stlbench.stl.language.structure import first_past, lookahead, negations_inside, signals, walk
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
    Predicate,
    Release,
    Since,
    TrueFormula,
    Until,
)

#: orders of that many events are written out: 3 in a row may come in 6 orders
EVENTS = 3
#: disjuncts beyond which a formula is left as it is
TERMS = 16


class Goal(NamedTuple):
    """F[start,stop] psi, psi in negation normal form."""

    start: int
    stop: int
    psi: Formula


def terms(start: int, stop: int, psi: Formula, negated: bool = False) -> list[Goal]:
    """F[start,stop] psi (or F[start,stop] !psi) as a disjunction; as it is where no rule helps."""
    whole = negations_inside(Not(psi) if negated else psi)
    found = _terms(start, stop, whole)
    return found if len(found) <= TERMS else [Goal(start, stop, whole)]


def _terms(start: int, stop: int, psi: Formula) -> list[Goal]:
    match psi:
        case Or(args):
            return [term for arg in args for term in _terms(start, stop, arg)]
        case Eventually(a, b, arg):
            return _terms(start + a, END if END in (stop, b) else stop + b, arg)
        case Always(a, b, Eventually(c, d, arg)) if stop == END > b:
            # Known first for the window that ends now: its last F by this sample, the others by their own windows.
            closed = (b - a) - (d - c)
            earlier = [Historically(0, closed, Once(0, d - c, arg))] if d < END and closed > 0 else []
            return [Goal(start + b + c, END, all_of([arg, *earlier]))]
        case And(args) if stop == END and start == 0:
            return _conjunction(args)
        case Release() if stop == END and start == 0:
            return _conjunction((psi,))
        case Until() if stop == END and start == 0:
            return _conjunction((psi,))
        case _:
            return [Goal(start, stop, psi)]


def _conjunction(args: Sequence[Formula]) -> list[Goal]:
    """F of a conjunction."""
    for choice in args:
        if isinstance(choice, Or) and any(_looks_ahead(each) for each in choice.args):
            others = [arg for arg in args if arg is not choice]
            return [term for each in choice.args for term in _terms(0, END, all_of([*others, each]))]
    events = [arg for arg in args if isinstance(arg, Eventually | Until | Release)]
    rest = [arg for arg in args if not isinstance(arg, Eventually | Until | Release)]
    match events:
        case [Eventually(a, b, goal)]:
            return _terms(a, END, all_of([*_conjuncts(goal), *([Once(a, b, all_of(rest))] if rest else [])]))
        case [Until(0, b, left, goal)] if b > 0:
            way = Since(0, b if b == END else b - 1, left, all_of([*rest, left]))
            begun = Once(1, 1, way)
            return (
                _terms(0, END, all_of([*_conjuncts(goal), Or((all_of(rest), begun))])) if rest else _terms(0, END, goal)
            )
        case [Release(0, b, left, right)] if b > 0:
            released = all_of([*_conjuncts(left), Since(0, b, right, all_of([*rest, right]))])
            held = Goal(0, END, all_of([*rest, Always(0, b, right)]))
            return [*_terms(0, END, released), held]
        case [_, _, *_] if len(events) <= EVENTS and all(
            isinstance(each, Eventually) and (each.a, each.b) == (0, END) for each in events
        ):
            goals = [each.arg for each in events if isinstance(each, Eventually)]
            return [term for last in orders(rest, goals) for term in _terms(0, END, last)]
        case _:
            return [Goal(0, END, all_of(args))]


def orders(rest: Sequence[Formula], goals: Sequence[Formula]) -> list[Formula]:
    """All goals, each at or after `rest`, by which of them comes last."""
    last = []
    for i, goal in enumerate(goals):
        others = [*goals[:i], *goals[i + 1 :]]
        before = orders(rest, others) if others else [all_of(rest)] if rest else []
        past = [Once(0, END, before[0] if len(before) == 1 else Or(tuple(before)))] if before else []
        last.append(all_of([*_conjuncts(goal), *past]))
    return last


def _conjuncts(formula: Formula) -> Sequence[Formula]:
    return formula.args if isinstance(formula, And) else (formula,)


def all_of(parts: Sequence[Formula]) -> Formula:
    return And(tuple(parts)) if len(parts) > 1 else parts[0]


def _looks_ahead(formula: Formula) -> bool:
    return lookahead(formula) > 0 or any(
        isinstance(node, Eventually | Until | Release | Always) for node in walk(formula)
    )


def varies(formula: Formula) -> bool:
    """Whether no predicate is a constant and no part looks back: then any value is possible at a step to come."""
    constant = any(
        isinstance(node, TrueFormula) or (isinstance(node, Predicate) and not signals(node)) for node in walk(formula)
    )
    return first_past(formula) is None and not constant
