"""How far a formula looks ahead, and what it is on a trace whose end is known."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeAlias

from stlbench.stl.errors import UnboundedError
from stlbench.stl.language.syntax import (
    END,
    Always,
    And,
    Eventually,
    Formula,
    Historically,
    Implies,
    Not,
    Once,
    Or,
    Past,
    Predicate,
    Release,
    Since,
    TrueFormula,
    Until,
)
from stlbench.stl.language.traversal import operands_of, require_formula, walk


def horizon(formula: Formula) -> int:
    """Steps that `formula` looks ahead, at least 0; a trace that decides it has `horizon + 1` samples.

    Tight for until: its left operand is not read at the last step, so `p U[0,b] q` with p deeper than q counts b - 1
    steps before p. Past operators look back, which needs no samples that follow.

    Raises:
        UnboundedError: an operator has no interval, so that no number of samples decides the formula.
    """
    if (operator := unbounded(formula)) is not None:
        reason = "reaches to the end of the trace and has no horizon; give it an interval [a,b]"
        raise UnboundedError(operator.letter, operator.position, reason)
    return lookahead(formula)


#: operators that look ahead
Ahead: TypeAlias = Always | Eventually | Until | Release


def unbounded(formula: Formula) -> Ahead | None:
    """The first operator of `formula` that looks ahead without an interval, if any."""
    require_formula(formula)
    for node in walk(formula):
        if isinstance(node, Ahead) and node.b == END:
            return node
    return None


def lookahead(formula: Formula) -> int:
    """Steps that must follow step t in a recorded trace for `formula` to be told at t.

    The horizon, where all operators have intervals. One without reads on to the last step at which its operands can be
    told, and needs one step at least.
    """
    match formula:
        case TrueFormula() | Predicate():
            return 0
        case Not(arg):
            return lookahead(arg)
        case And(args) | Or(args):
            return max(map(lookahead, args))
        case Implies(left, right):
            return max(lookahead(left), lookahead(right))
        case Always(_, b, arg) | Eventually(_, b, arg):
            return lookahead(arg) + (0 if b == END else b)
        case Until(_, b, left, right) | Release(_, b, left, right):
            if b == END:
                return max(lookahead(left), lookahead(right))
            before = b - 1 + lookahead(left) if b > 0 else 0
            return max(before, b + lookahead(right))
        case Historically(a, _, arg) | Once(a, _, arg):
            return max(0, lookahead(arg) - a)
        case Since(a, b, left, right):
            return max(0, lookahead(right) - a, lookahead(left) if b > 0 else 0)


def lookbehind(formula: Formula) -> int:
    """Steps that a predicate may be read before step t, for `formula` at t.

    A past operator without an interval counts one: what it was at the step before says all about earlier ones.
    """
    behind = max((lookbehind(operand) for operand in operands_of(formula)), default=0)
    if isinstance(formula, Past):
        return behind + (1 if formula.b == END else formula.b)
    return behind


def resolve_end(formula: Formula, last: int) -> Formula:
    """`formula` with an interval for each operator without one, to be read at t = 0 of traces with samples 0..last.

    The robustness and verdict of such traces stay: `G p` becomes `G[0, last - horizon(p)] p`.

    Raises:
        UnboundedError: an operator without an interval stands inside another temporal operator, where it means another
            interval at each step.
        ValueError: the trace ends before an operand can be told.
    """
    require_formula(formula)
    match formula:
        case Not(arg):
            return replace(formula, arg=resolve_end(arg, last))
        case And(args) | Or(args):
            return replace(formula, args=tuple(resolve_end(arg, last) for arg in args))
        case Implies(left, right):
            return replace(formula, left=resolve_end(left, last), right=resolve_end(right, last))
        case Always() | Eventually() | Until() | Release() | Historically() | Once() | Since():
            for operand in operands_of(formula):
                _refuse_unbounded(operand)
            if isinstance(formula, Past) or formula.b < END:
                return formula
            return replace(formula, b=_end(formula, last))
        case _:
            return formula


def _refuse_unbounded(operand: Formula) -> None:
    if (operator := unbounded(operand)) is not None:
        reason = "stands inside another temporal operator, where it has no fixed interval; give it one, [a,b]"
        raise UnboundedError(operator.letter, operator.position, reason)


def _end(operator: Ahead, last: int) -> int:
    end = last - lookahead(operator)
    if end < 0:
        needed = f"{operator.letter} without an interval needs {lookahead(operator) + 1} samples"
        raise ValueError(f"{needed}, the trace has {last + 1}")
    return end
