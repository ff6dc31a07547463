"""How far a formula looks ahead."""

from __future__ import annotations

from stlbench.stl.language.syntax import (
    Always,
    And,
    Eventually,
    Formula,
    Implies,
    Not,
    Or,
    Predicate,
    TrueFormula,
    Until,
)


def horizon(formula: Formula) -> int:
    """Steps that `formula` looks ahead, at least 0; a trace that decides it has `horizon + 1` samples.

    Tight for until: its left operand is not read at the last step, so `p U[0,b] q` with p deeper than q counts b - 1
    steps before p.
    """
    match formula:
        case TrueFormula() | Predicate():
            return 0
        case Not(arg):
            return horizon(arg)
        case And(args) | Or(args):
            return max(map(horizon, args))
        case Implies(left, right):
            return max(horizon(left), horizon(right))
        case Always(_, b, arg) | Eventually(_, b, arg):
            return b + horizon(arg)
        case Until(_, b, left, right):
            before = b - 1 + horizon(left) if b > 0 else 0
            return max(before, b + horizon(right))
