"""The traits of a formula: words that formulas of the same form share."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

from stlbench import stl
from stlbench.stl import Always, Eventually, Formula, Or, Release, Until
from stlbench.stl.language.structure import negations_inside, operands_of, walk
from stlbench.task.windows import Window, windows

TRAITS = (
    "again and again",
    "one after another",
    "choice",
    "until",
    "stay",
    "fixed times",
    "several goals",
    "windows that overlap",
    "invariant",
)


def traits(formula: Formula) -> frozenset[str]:
    """Those of TRAITS that a formula with intervals in steps has.

    They are about its form, and say nothing of places, sizes or speeds. Negations are pushed into it first, so p -> F q
    counts as a choice.
    """
    nodes = list(walk(negations_inside(formula)))
    goals = [window for window in windows(formula) if not window.invariant]
    has = (
        _is_in(nodes, Always, Eventually),
        any(isinstance(node, Eventually) and _is_temporal_and(node.arg) for node in nodes),
        any(isinstance(node, Or) and stl.is_temporal(node) for node in nodes),
        any(isinstance(node, Until | Release) for node in nodes),
        _is_in(nodes, Eventually, Always),
        any(isinstance(node, Always) and node.a > 0 for node in nodes),
        len(goals) > 1,
        any(_overlap(*pair) for pair in combinations(goals, 2)),
        len(goals) < len(windows(formula)),
    )
    return frozenset(trait for trait, is_so in zip(TRAITS, has, strict=True) if is_so)


def _is_in(nodes: Iterable[object], outer: type[Always | Eventually], inner: type[Always | Eventually]) -> bool:
    """Whether an operator of the inner kind stands anywhere within one of the outer kind."""
    return any(isinstance(node, inner) for out in nodes if isinstance(out, outer) for node in walk(out.arg))


def _is_temporal_and(formula: Formula) -> bool:
    """Whether it is a conjunction of something that has to hold now, and something later."""
    return isinstance(formula, stl.And) and any(isinstance(part, Eventually) for part in operands_of(formula))


def _overlap(one: Window, other: Window) -> bool:
    """Whether they share more than a border, or are the same sample."""
    return one.begin == other.begin == one.end == other.end or (one.begin < other.end and other.begin < one.end)
