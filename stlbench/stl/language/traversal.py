"""What a formula is made of: its operands, signals, and whether it has temporal operators."""

from __future__ import annotations

from collections.abc import Iterator

from stlbench.stl.language.syntax import (
    Always,
    And,
    AnyNode,
    Binary,
    Call,
    Eventually,
    Formula,
    Implies,
    Negative,
    Not,
    Or,
    Predicate,
    Signal,
    Until,
)


def signals(formula: Formula) -> tuple[str, ...]:
    """Names of the signals that `formula` uses, each once, in order of first appearance."""
    return tuple(dict.fromkeys(node.name for node in walk(formula) if isinstance(node, Signal)))


def is_temporal(formula: Formula) -> bool:
    """Whether `formula` contains G, F or U (also one of zero length such as `G[0,0]`)."""
    return any(isinstance(node, Always | Eventually | Until) for node in walk(formula))


def children(node: AnyNode) -> tuple[AnyNode, ...]:
    """The operands of `node`, left to right."""
    match node:
        case Call(_, args) | And(args) | Or(args):
            return args
        case Predicate(_, left, right) | Binary(_, left, right) | Implies(left, right) | Until(_, _, left, right):
            return left, right
        case Negative(arg) | Not(arg) | Always(_, _, arg) | Eventually(_, _, arg):
            return (arg,)
        case _:
            return ()


def walk(node: AnyNode) -> Iterator[AnyNode]:
    """`node` and everything in it, in order of appearance."""
    stack = [node]
    while stack:
        node = stack.pop()
        yield node
        stack.extend(reversed(children(node)))
