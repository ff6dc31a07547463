"""The form of a formula: its windows, the sizes at which its predicates matter, the forms that methods take, and the
words that formulas of the same form share.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

from stlbench import stl
from stlbench.stl.language.structure import is_temporal, negations_inside, operands_of, walk


@dataclass(frozen=True)
class Window:
    """A part of a formula without temporal operators, with the first and the last sample at which it can count."""

    psi: stl.Formula
    begin: int
    end: int
    invariant: bool
    """Whether it has to hold from sample 0 on, as in G[0,b] psi and psi U[a,b] goal."""
    throughout: bool
    """Whether it has to hold at all its samples, as in G[a,b] psi."""


def recurring(formula: stl.Formula) -> Iterator[stl.Eventually]:
    """The parts that a formula asks for again and again: F inside G."""
    for always in walk(formula):
        if isinstance(always, stl.Always):
            yield from (node for node in walk(always.arg) if isinstance(node, stl.Eventually))


def windows(formula: stl.Formula) -> tuple[Window, ...]:
    """The windows of a formula with intervals in steps, in order of appearance. Negations are pushed into them."""
    return tuple(_inside(negations_inside(formula), 0, 0, True, True))  # in the order in which `_rebuilt` visits parts


def with_parts(formula: stl.Formula, part: Callable[[Window], stl.Formula]) -> stl.Formula:
    """The formula with another part in place of the `psi` of each window."""
    parts = map(part, windows(formula))
    return _rebuilt(negations_inside(formula), parts)


def _rebuilt(formula: stl.Formula, parts: Iterator[stl.Formula]) -> stl.Formula:
    if not stl.is_temporal(formula):
        return next(parts)
    return formula.with_operands([_rebuilt(operand, parts) for operand in operands_of(formula)])


def _inside(formula: stl.Formula, begin: int, end: int, at_once: bool, always: bool) -> Iterator[Window]:
    """The windows of a formula that counts at samples begin..end.

    Args:
        at_once: whether it has to hold at sample 0, if that is one of them.
        always: whether it has to hold at all of them.
    """
    if not stl.is_temporal(formula):  # sample 0 alone is no invariant, as no action changes it
        yield Window(formula, begin, end, at_once and begin == 0 and end > 0, always)
        return
    match formula:
        case stl.Always(a, b, arg):
            yield from _inside(arg, begin + a, end + b, at_once, always)
        case stl.Eventually(a, b, arg):  # F[a,a] is G[a,a]
            yield from _inside(arg, begin + a, end + b, at_once and a == b, always and a == b)
        case stl.Until(a, b, left, right):
            yield from _inside(left, begin, end + max(b - 1, 0), at_once and b > 0, False)
            yield from _inside(right, begin + a, end + b, at_once and a == b, always and a == b)
        case stl.Release(a, b, left, right):
            yield from _inside(left, begin, end + max(b - 1, 0), False, False)
            yield from _inside(right, begin + a, end + b, at_once, False)
        case stl.Historically(a, b, arg):
            yield from _inside(arg, max(0, begin - b), max(0, end - a), at_once and b == 0, always)
        case stl.Once(a, b, arg):
            yield from _inside(arg, max(0, begin - b), max(0, end - a), at_once and b == 0, False)
        case stl.Since(a, b, left, right):
            yield from _inside(left, max(0, begin - b), end, False, False)
            yield from _inside(right, max(0, begin - b), max(0, end - a), False, False)
        case _:
            both = isinstance(formula, stl.And)
            for part in operands_of(formula):
                yield from _inside(part, begin, end, at_once and both, always and both)


Box = Mapping[str, tuple[float, float]]
"""Signal -> the ends of its range."""


class Scale(NamedTuple):
    """Sizes of a margin, in its own unit, all positive."""

    best: float
    """The largest margin within the ranges of the signals."""
    worst: float
    """The largest violation within the ranges."""
    tight: bool = False
    """Whether no margin is above 0: it is then met at its border alone, as `collisions <= 0`."""
    sure: bool = False
    """Whether none is below 0."""

    @property
    def negated(self) -> Scale:
        """The sizes of the opposite margin."""
        return Scale(self.worst, self.best, self.sure, self.tight)

    @property
    def near(self) -> float:
        """The size at which a difference decides: the smaller of the two, as the radius of a goal or of an obstacle."""
        return min(self.best, self.worst)

    @property
    def far(self) -> float:
        """The largest magnitude."""
        return max(self.best, self.worst)


def scale(psi: stl.Formula, box: Box) -> Scale:
    """The sizes of the margin of a formula without temporal operators, from its proven bounds over the box.

    A side that the margin cannot reach, or that has no finite bound, counts a tenth of the other one, or of 1.
    """
    above, below = _sides(psi, tuple(box.items()))
    largest = max(above, below) or 1.0
    # A proven bound lies up to a tolerance beyond the true extreme, so a side as small as this may be 0.
    tight, sure = (side <= 1e-5 * largest for side in (above, below))
    return Scale(0.1 * largest if tight else above, 0.1 * largest if sure else below, tight, sure)


def violated(psi: stl.Formula, box: Box) -> bool:
    """Whether a formula without temporal operators is proven to hold nowhere in the box."""
    above, below = _sides(psi, tuple(box.items()))
    return above == 0 < below


def reach(expression: stl.Expression, box: Box) -> float:
    """The largest magnitude of an expression over the box; 1 if it has no finite bound, or is 0 everywhere."""
    return max(_sides(as_margin(expression), tuple(box.items()))) or 1.0


def as_margin(expression: stl.Expression) -> stl.Predicate:
    """A predicate whose margin is the expression."""
    return stl.Predicate(">=", expression, stl.Number(0.0))


@lru_cache(maxsize=1024)
def _sides(psi: stl.Formula, box: tuple[tuple[str, tuple[float, float]], ...]) -> tuple[float, float]:
    """How far the margin gets above and below 0; 0 if it does not, or if nothing is proven."""
    try:
        bounds = stl.bounds(psi, dict(box), nodes=20_000)  # a tenth of the usual work: a size need not be exact
    except stl.UndefinedError:  # it has no value somewhere in the box, as x / y
        return 0.0, 0.0
    high, low = (side if math.isfinite(side) and side > 0 else 0.0 for side in (bounds.high, -bounds.low))
    return high, low


def normal_form(formula: stl.Formula) -> stl.Formula:
    """The formula in a form that more methods take.

    - Inside of F or G, a part without temporal operators beside others becomes G[0,0] of it. This is the same formula.
    - G[0,b] p & G[0,a] phi with b > a becomes G[0,a] (phi & G[0,b-a] p), where phi is temporal and p is not. This is
      the same formula.
    - Inside of F or G, G[c,d] p | G[c,d] q becomes G[c,d] (p | q). Every trace that satisfies the first satisfies the
      second, but not the other way round.
    """
    if isinstance(formula, stl.And):
        args = tuple(map(normal_form, formula.args))
        joined = _joined(args)
        return replace(formula, args=args) if joined is None else joined
    if isinstance(formula, stl.Always | stl.Eventually):
        return replace(formula, arg=_inner(formula.arg))
    return formula


def _joined(args: Sequence[stl.Formula]) -> stl.Formula | None:
    """Two invariants as one, if one of them is temporal inside and ends first; None for others."""
    if len(args) != 2 or not all(isinstance(arg, stl.Always) and arg.a == 0 for arg in args):
        return None
    first, second = args
    assert isinstance(first, stl.Always)
    assert isinstance(second, stl.Always)
    plain, nested = (second, first) if is_temporal(first.arg) else (first, second)
    if is_temporal(plain.arg) or not is_temporal(nested.arg) or plain.b <= nested.b:
        return None
    return replace(nested, arg=stl.And((nested.arg, stl.Always(0, plain.b - nested.b, plain.arg))))


def _inner(formula: stl.Formula) -> stl.Formula:
    """The operand of F or G."""
    match formula:
        case stl.Or(args) if all(isinstance(arg, stl.Always) for arg in args):
            windows = [arg for arg in args if isinstance(arg, stl.Always)]
            alike = len({(arg.a, arg.b) for arg in windows}) == 1 and not any(is_temporal(arg.arg) for arg in windows)
            return (
                stl.Always(windows[0].a, windows[0].b, stl.Or(tuple(arg.arg for arg in windows))) if alike else formula
            )
        case stl.And(args) if is_temporal(formula):
            plain = [arg for arg in args if not is_temporal(arg)]
            rest = [normal_form(arg) for arg in args if is_temporal(arg)]
            held = [stl.Always(0, 0, plain[0] if len(plain) == 1 else stl.And(tuple(plain)))] if plain else []
            return stl.And((*rest, *held))
        case _:
            return normal_form(formula) if stl.is_temporal(formula) else formula


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


def traits(formula: stl.Formula) -> frozenset[str]:
    """The TRAITS that a formula with intervals in steps has.

    They are about its form, and say nothing of places, sizes or speeds. Negations are pushed into it first, so p -> F q
    counts as a choice.
    """
    nodes = list(walk(negations_inside(formula)))
    goals = [window for window in windows(formula) if not window.invariant]
    has = (
        _is_in(nodes, stl.Always, stl.Eventually),
        any(isinstance(node, stl.Eventually) and _is_temporal_and(node.arg) for node in nodes),
        any(isinstance(node, stl.Or) and stl.is_temporal(node) for node in nodes),
        any(isinstance(node, stl.Until | stl.Release) for node in nodes),
        _is_in(nodes, stl.Eventually, stl.Always),
        any(isinstance(node, stl.Always) and node.a > 0 for node in nodes),
        len(goals) > 1,
        any(_overlap(*pair) for pair in combinations(goals, 2)),
        len(goals) < len(windows(formula)),
    )
    return frozenset(trait for trait, is_so in zip(TRAITS, has, strict=True) if is_so)


def _is_in(
    nodes: Iterable[object], outer: type[stl.Always | stl.Eventually], inner: type[stl.Always | stl.Eventually]
) -> bool:
    """Whether an operator of the inner kind stands anywhere within one of the outer kind."""
    return any(isinstance(node, inner) for out in nodes if isinstance(out, outer) for node in walk(out.arg))


def _is_temporal_and(formula: stl.Formula) -> bool:
    """Whether it is a conjunction of something that has to hold now, and something later."""
    return isinstance(formula, stl.And) and any(isinstance(part, stl.Eventually) for part in operands_of(formula))


def _overlap(one: Window, other: Window) -> bool:
    """Whether they share more than a border, or are the same sample."""
    return one.begin == other.begin == one.end == other.end or (one.begin < other.end and other.begin < one.end)
