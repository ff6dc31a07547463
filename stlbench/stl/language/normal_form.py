"""Formulas with their negations pushed inwards, so that more of any predicate is never worse."""

from __future__ import annotations

from typing import TypeAlias

from stlbench.stl.language.syntax import (
    Always,
    And,
    Eventually,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Release,
    Since,
    Until,
)
from stlbench.stl.language.traversal import is_temporal, require_formula


def negations_inside(formula: Formula, to_predicates: bool = False) -> Formula:
    """An equivalent formula whose negations stand at its parts without temporal operators.

    Robustness and verdict are the same on every trace. `!(p U q)` is `!p R !q`, and the other way round. `!(p S q)`
    stays as it is, since no operator is its dual.

    Args:
        formula: any formula.
        to_predicates: push on to the predicates, also within parts without temporal operators.
    """
    require_formula(formula)
    return _pushed(formula, False, to_predicates)


def _pushed(formula: Formula, negated: bool, to_predicates: bool) -> Formula:
    if not to_predicates and not is_temporal(formula):
        return Not(formula) if negated else formula
    match formula:
        case Not(arg):
            return _pushed(arg, not negated, to_predicates)
        case And(args) | Or(args):
            kind = And if isinstance(formula, And) != negated else Or
            return kind(tuple(_pushed(arg, negated, to_predicates) for arg in args))
        case Implies(left, right):
            parts = _pushed(left, not negated, to_predicates), _pushed(right, negated, to_predicates)
            return And(parts) if negated else Or(parts)
        case Always(a, b, arg) | Eventually(a, b, arg) | Historically(a, b, arg) | Once(a, b, arg):
            window = _WINDOWS[type(formula)] if negated else type(formula)
            return window(a, b, _pushed(arg, negated, to_predicates))
        case Until(a, b, left, right) | Release(a, b, left, right):
            between = Until if isinstance(formula, Until) != negated else Release
            return between(a, b, _pushed(left, negated, to_predicates), _pushed(right, negated, to_predicates))
        case Since(a, b, left, right):
            since = Since(a, b, _pushed(left, False, to_predicates), _pushed(right, False, to_predicates))
            return Not(since) if negated else since
        case _:
            return Not(formula) if negated else formula


_Window: TypeAlias = Always | Eventually | Historically | Once
_WINDOWS: dict[type[_Window], type[_Window]] = {
    Always: Eventually,
    Eventually: Always,
    Historically: Once,
    Once: Historically,
}
