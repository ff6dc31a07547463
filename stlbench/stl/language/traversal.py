"""What a formula is made of: its operands, signals, and whether it has temporal operators."""

from __future__ import annotations

from collections.abc import Iterator
from typing import cast

from stlbench.stl.errors import shorten
from stlbench.stl.language.node import Node
from stlbench.stl.language.syntax import AnyNode, Expression, Formula, Past, Signal, Temporal


def require_formula(value: object) -> None:
    """Raise TypeError where text, or anything else, stands for a formula."""
    if isinstance(value, Formula):
        return
    hint = "; parse(text) makes one" if isinstance(value, str) else ""
    shown = str(value) if isinstance(value, Node) else repr(value)
    raise TypeError(f"expected a formula, got {type(value).__name__} {shorten(shown)}{hint}")


def require_pointwise(psi: Formula) -> None:
    """Raise ValueError for a formula with temporal operators."""
    if is_temporal(psi):
        raise ValueError(f"expected a formula without temporal operators, got {shorten(str(psi))}")


def signals(formula: Formula | Expression) -> tuple[str, ...]:
    """Names of the signals that a formula or an expression uses, each once, in order of first appearance."""
    if not isinstance(formula, Expression):
        require_formula(formula)
    return tuple(dict.fromkeys(node.name for node in walk(formula) if isinstance(node, Signal)))


def is_temporal(formula: Formula) -> bool:
    """Whether `formula` contains a temporal operator (also one of zero length such as `G[0,0]`)."""
    require_formula(formula)
    return any(isinstance(node, Temporal) for node in walk(formula))


def operands_of(formula: Formula) -> tuple[Formula, ...]:
    """The formulas right below this one; none of a predicate."""
    return tuple(operand for operand in formula.operands if isinstance(operand, Formula))


def first_past(formula: Formula) -> Past | None:
    """The first past operator of `formula`, if any."""
    return next((node for node in walk(formula) if isinstance(node, Past)), None)


def walk(node: AnyNode) -> Iterator[AnyNode]:
    """`node` and everything in it, in order of appearance."""
    stack = [node]
    while stack:
        node = stack.pop()
        yield node
        stack.extend(reversed(cast(tuple[AnyNode, ...], node.operands)))
