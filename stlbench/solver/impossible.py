"""Why no episode can satisfy a formula, shown by interval arithmetic over the ranges of its signals.

Each rule is sound: a reason is a proof, as far as the ranges are true. None proves nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from stlbench import stl
from stlbench.stl import Always, And, Eventually, Formula, Once, Or, Since, Until
from stlbench.stl.language.structure import negations_inside

Box = Mapping[str, tuple[float, float]]
"""Signal -> its range."""
_NODES = 2000
"""Boxes that a proof may examine."""
_MOST = 100
"""Conjunctions that are looked at."""


@dataclass(frozen=True)
class _Demand:
    """A part without temporal operators that every satisfying episode meets."""

    psi: Formula
    begin: int
    end: int
    throughout: bool
    """At all of the samples begin..end, or at one of them."""

    @property
    def text(self) -> str:
        first = f"sample {self.begin}" if self.begin == self.end else f"samples {self.begin} to {self.end}"
        one = "one of " if not self.throughout and self.begin < self.end else ""
        return f"'{self.psi}' at {one}{first}"


def why_impossible(formula: Formula, box: Box) -> str | None:
    """The reason, in words; None where none is known. Intervals of the formula are in steps."""
    pushed = negations_inside(formula)
    return _nowhere(pushed, box) or _conflict(list(_demands(pushed, 0, 0, True)), box)


def _nowhere(formula: Formula, box: Box) -> str | None:
    """Why a formula holds at no sample."""
    if not stl.is_temporal(formula):
        return _beyond(formula, box)
    match formula:
        case And(args):
            return next(filter(None, (_nowhere(arg, box) for arg in args)), None)
        case Or(args):
            reasons = [_nowhere(arg, box) for arg in args]
            return "; ".join(filter(None, reasons)) if all(reasons) else None
        case Always(arg=arg) | Eventually(arg=arg) | Once(arg=arg):
            return _nowhere(arg, box)
        case Until(right=right) | Since(right=right):
            return _nowhere(right, box)
    return None


def _beyond(psi: Formula, box: Box) -> str | None:
    """Why a part holds nowhere within the ranges."""
    if not _holds_nowhere(psi, box):
        return None
    ends = ", ".join(f"{name} is from {box[name][0]:g} to {box[name][1]:g}" for name in stl.signals(psi))
    return f"'{psi}' never holds: {ends}"


def _holds_nowhere(psi: Formula, box: Box) -> bool:
    try:
        return stl.bounds(psi, box, nodes=_NODES).high < 0
    except ValueError:  # no proof: it is not defined all over the box
        return False


def _demands(formula: Formula, begin: int, end: int, throughout: bool) -> Iterator[_Demand]:
    """What follows from a formula that holds at all the samples begin..end, or at one of them."""
    if not stl.is_temporal(formula):
        yield _Demand(formula, begin, end, throughout)
        return
    surely = throughout or begin == end
    match formula:
        case And(args):
            for arg in args:
                yield from _demands(arg, begin, end, throughout)
        case Always(a, b, arg) if surely:
            yield from _demands(arg, begin + a, end + b, True)
        case Always(a, b, arg) if end + a <= begin + b:  # whichever the sample is, these are among its own
            yield from _demands(arg, end + a, begin + b, True)
        case Eventually(a, b, arg) if surely:
            for sample in {begin, end}:
                yield from _demands(arg, sample + a, sample + b, False)
        case Eventually(a, b, arg):
            yield from _demands(arg, begin + a, end + b, False)
        case Until(a, b, left, right) if surely:
            if a > 0:  # else the right operand may hold at once
                yield from _demands(left, begin, end + a - 1, True)
            yield from _demands(right, begin + a, begin + b, False)


def _conflict(demands: Sequence[_Demand], box: Box) -> str | None:
    """Why these cannot be met together."""
    held = [demand for demand in demands if demand.throughout or demand.begin == demand.end]
    known = set[Formula]()
    for demand in demands:
        others = [each for each in held if each is not demand and each.begin <= demand.end and demand.begin <= each.end]
        if others and (reason := _against(demand, others, box, known)):
            return reason
    return None


def _against(demand: _Demand, others: Sequence[_Demand], box: Box, known: set[Formula]) -> str | None:
    """Why a demand has no sample at which it goes with the others; `known` are conjunctions that are possible."""
    within = [min(max(edge, demand.begin), demand.end + 1) for each in others for edge in (each.begin, each.end + 1)]
    edges = sorted({demand.begin, demand.end + 1, *within})
    ruled_out = list[_Demand]()
    for begin, _ in pairwise(edges):
        there = [each for each in others if each.begin <= begin <= each.end]
        conjunction = And((demand.psi, *(each.psi for each in there))) if there else None
        if conjunction is None or conjunction in known or len(known) >= _MOST or not _holds_nowhere(conjunction, box):
            known |= {conjunction} if conjunction is not None else set()
            if not demand.throughout:
                return None
            continue
        ruled_out += [each for each in there if each not in ruled_out]
        if demand.throughout:
            break
    if not ruled_out:
        return None
    return f"{demand.text} contradicts {' and '.join(each.text for each in ruled_out)}"
