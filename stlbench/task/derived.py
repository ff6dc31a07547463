"""The derived formula: what reward methods are given on the track `auto` in place of the task's own formula.

Its predicates are those of the task, brought to one scale by their roles. Each keeps its sign, so the same traces
satisfy both formulas. The referee scores the task's own formula.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from math import log

from stlbench import stl
from stlbench.stl import Formula, Implies, Not, Predicate
from stlbench.task.scales import Box, Scale, scale
from stlbench.task.windows import Window, with_parts

_Shape = Callable[[str, Scale], str]
"""The text of a margin and its sizes -> the text of the margin on the common scale."""

CLEARANCE = 0.3
"""What an invariant pays for clearance, as a share of what it takes for a violation."""


def derived(formula: Formula, box: Box) -> Formula:
    """The formula with its predicates on one scale.

    With w the near size of the margin m of a predicate (`scales.Scale`), the margin becomes

    - of a goal, for m < 0 the distance on a logarithmic scale, -log(1 - m / w) / log(1 + worst / w), from -1 to 0;
      for m >= 0 m / (2 best), with `best` the largest margin of all that has to hold with it;
    - of an invariant, with d = w / 2: m / d, at least -1, where it is violated, and .3 min(m / d, 1) where it holds.
      So a violation counts as much as the farthest goal, and a goal that is far does not hide an obstacle.

    Args:
        formula: of the task, intervals in steps.
        box: the ranges of the signals.
    """
    return with_parts(formula, partial(_part, box=box))


def _part(window: Window, box: Box) -> Formula:
    if window.invariant:
        return _shaped(window.psi, _as_invariant, box)
    best = scale(window.psi, box).best
    return _shaped(window.psi, lambda margin, size: _as_goal(margin, size, best), box)


def _shaped(psi: Formula, shape: _Shape, box: Box, negated: bool = False) -> Formula:
    """A formula without temporal operators with another scale of its predicates; `negated` inside of a negation."""
    match psi:
        case Predicate():
            return _predicate(psi, shape, box, negated)
        case Not(arg):
            return replace(psi, arg=_shaped(arg, shape, box, not negated))
        case stl.And(args) | stl.Or(args):
            return replace(psi, args=tuple(_shaped(arg, shape, box, negated) for arg in args))
        case Implies(left, right):
            return replace(psi, left=_shaped(left, shape, box, not negated), right=_shaped(right, shape, box, negated))
        case _:
            return psi


def _predicate(predicate: Predicate, shape: _Shape, box: Box, negated: bool) -> Formula:
    """The predicate on another scale. If it is negated, the margin of its negation is the one to make positive."""
    greater, less = predicate.left, predicate.right
    if predicate.op.startswith("<"):
        greater, less = less, greater
    size = scale(predicate, box)
    if negated:
        greater, less, size = less, greater, Scale(size.worst, size.best)
    comparison = predicate.op[1:]  # whether the border itself counts
    return stl.parse(f"{shape(f'({greater} - ({less}))', size)} {'<' if negated else '>'}{comparison} 0")


def _as_goal(margin: str, size: Scale, best: float) -> str:
    near = min(size.near, size.worst / 2)
    distance = f"log(1 + max(0, -{margin}) / {near:.9g}) / {log(1 + size.worst / near):.9g}"
    return f"max(0, {margin}) / {2 * best:.9g} - {distance}"


def _as_invariant(margin: str, size: Scale) -> str:
    depth = f"{margin} / {size.near / 2:.9g}"
    return f"max(-1, min({depth}, {CLEARANCE:g} * min({depth}, 1)))"
