"""The windows of a formula: its parts without temporal operators, and the samples at which the formula reads them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from stlbench import stl
from stlbench.stl import Always, Eventually, Formula, Historically, Once, Release, Since, Until
from stlbench.stl.language.structure import negations_inside, operands_of


@dataclass(frozen=True)
class Window:
    """A part of a formula without temporal operators, with the first and the last sample at which it can count."""

    psi: Formula
    begin: int
    end: int
    invariant: bool
    """Whether it has to hold from sample 0 on, as in G[0,b] psi and psi U[a,b] goal."""
    throughout: bool
    """Whether it has to hold at all its samples, as in G[a,b] psi."""


def windows(formula: Formula) -> tuple[Window, ...]:
    """The windows of a formula with intervals in steps, in order of appearance. Negations are pushed into them."""
    return tuple(_inside(negations_inside(formula), 0, 0, True, True))


def with_parts(formula: Formula, part: Callable[[Window], Formula]) -> Formula:
    """The formula with another part in place of the `psi` of each window."""
    parts = map(part, windows(formula))
    return _rebuilt(negations_inside(formula), parts)


def _rebuilt(formula: Formula, parts: Iterator[Formula]) -> Formula:
    if not stl.is_temporal(formula):
        return next(parts)
    return formula.with_operands([_rebuilt(operand, parts) for operand in operands_of(formula)])


def _inside(formula: Formula, begin: int, end: int, at_once: bool, always: bool) -> Iterator[Window]:
    """The windows of a formula that counts at samples begin..end.

    Args:
        at_once: whether it has to hold at sample 0, where that is one of them.
        always: whether it has to hold at all of them.
    """
    if not stl.is_temporal(formula):
        yield Window(formula, begin, end, at_once and begin == 0 and end > 0, always)
        return
    match formula:
        case Always(a, b, arg):
            yield from _inside(arg, begin + a, end + b, at_once, always)
        case Eventually(a, b, arg):  # of one sample it is G[a,a]
            yield from _inside(arg, begin + a, end + b, at_once and a == b, always and a == b)
        case Until(a, b, left, right):
            yield from _inside(left, begin, end + max(b - 1, 0), at_once and b > 0, False)
            yield from _inside(right, begin + a, end + b, at_once and a == b, always and a == b)
        case Release(a, b, left, right):
            yield from _inside(left, begin, end + max(b - 1, 0), False, False)
            yield from _inside(right, begin + a, end + b, at_once, False)
        case Historically(a, b, arg):
            yield from _inside(arg, max(0, begin - b), max(0, end - a), at_once and b == 0, always)
        case Once(a, b, arg):
            yield from _inside(arg, max(0, begin - b), max(0, end - a), at_once and b == 0, False)
        case Since(a, b, left, right):
            yield from _inside(left, max(0, begin - b), end, False, False)
            yield from _inside(right, max(0, begin - b), max(0, end - a), False, False)
        case _:
            both = isinstance(formula, stl.And)
            for part in operands_of(formula):
                yield from _inside(part, begin, end, at_once and both, always and both)
