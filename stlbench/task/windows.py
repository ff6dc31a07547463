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


def windows(formula: Formula) -> tuple[Window, ...]:
    """The windows of a formula with intervals in steps, in order of appearance. Negations are pushed into them."""
    return tuple(_inside(negations_inside(formula), 0, 0, True))


def with_parts(formula: Formula, part: Callable[[Window], Formula]) -> Formula:
    """The formula with another part in place of the `psi` of each window."""
    parts = map(part, windows(formula))
    return _rebuilt(negations_inside(formula), parts)


def _rebuilt(formula: Formula, parts: Iterator[Formula]) -> Formula:
    if not stl.is_temporal(formula):
        return next(parts)
    return formula.with_operands([_rebuilt(operand, parts) for operand in operands_of(formula)])


def _inside(formula: Formula, begin: int, end: int, at_once: bool) -> Iterator[Window]:
    """The windows of a formula that counts at samples begin..end; `at_once` where that includes sample 0 for sure."""
    if not stl.is_temporal(formula):
        yield Window(formula, begin, end, at_once and begin == 0 and end > 0)
        return
    match formula:
        case Always(a, b, arg):
            yield from _inside(arg, begin + a, end + b, at_once)
        case Eventually(a, b, arg):
            yield from _inside(arg, begin + a, end + b, at_once and a == b)  # of one sample it is G[a,a]
        case Until(a, b, left, right):
            yield from _inside(left, begin, end + max(b - 1, 0), at_once and b > 0)
            yield from _inside(right, begin + a, end + b, at_once and a == b)
        case Release(a, b, left, right):
            yield from _inside(left, begin, end + max(b - 1, 0), False)
            yield from _inside(right, begin + a, end + b, at_once)
        case Historically(a, b, arg) | Once(a, b, arg):
            yield from _inside(arg, max(0, begin - b), max(0, end - a), at_once and b == 0)
        case Since(a, b, left, right):
            yield from _inside(left, max(0, begin - b), end, False)
            yield from _inside(right, max(0, begin - b), max(0, end - a), False)
        case _:
            both = at_once and isinstance(formula, stl.And)
            for part in operands_of(formula):
                yield from _inside(part, begin, end, both)
