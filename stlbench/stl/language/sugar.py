"""Operators that are written with others, so that every evaluator has them at once.

They print as what they stand for.
"""

from __future__ import annotations

from stlbench.stl.errors import Position
from stlbench.stl.language.syntax import Always, And, Formula, Implies, Not, Or, Release, Until


def iff(left: Formula, right: Formula, position: Position | None = None) -> Formula:
    """`left <-> right`: (left -> right) & (right -> left)."""
    ways = Implies(left, right, position=position), Implies(right, left, position=position)
    return And(ways, position=position)


def xor(left: Formula, right: Formula, position: Position | None = None) -> Formula:
    """`left xor right`: (left | right) & !(left & right)."""
    both = And((left, right), position=position)
    return And((Or((left, right), position=position), Not(both, position=position)), position=position)


def release(a: int, b: int, left: Formula, right: Formula, position: Position | None = None) -> Formula:
    """`left R[a,b] right`, intervals in steps: as !(!left U[a,b] !right).

    At every step t' of [t+a, t+b] right holds, or left holds at some step of [t, t').
    """
    return Release(a, b, left, right, position=position)


def weak_until(a: int, b: int, left: Formula, right: Formula, position: Position | None = None) -> Formula:
    """`left W[a,b] right`: (left U[a,b] right) | G[0,b] left, that is until, or left all the way."""
    until = Until(a, b, left, right, position=position)
    return Or((until, Always(0, b, left, position=position)), position=position)
