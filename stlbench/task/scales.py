"""At which sizes a predicate's margin matters: the same for every way to write the predicate."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

from stlbench import stl
from stlbench.stl import Expression, Number, Predicate

Box = Mapping[str, tuple[float, float]]
"""Signal -> the ends of its range."""


class Scale(NamedTuple):
    """Sizes of a margin, in its own unit, all positive."""

    best: float
    """The largest margin within the ranges of the signals."""
    worst: float
    """The largest violation within the ranges."""
    tight: bool = False
    """Whether no margin is above 0, so that it is met at its border alone, as `collisions <= 0`."""
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
    tight, sure = (side <= 1e-5 * largest for side in (above, below))
    return Scale(0.1 * largest if tight else above, 0.1 * largest if sure else below, tight, sure)


def violated(psi: stl.Formula, box: Box) -> bool:
    """Whether a formula without temporal operators is proven to hold nowhere in the box."""
    above, below = _sides(psi, tuple(box.items()))
    return above == 0 < below


def reach(expression: Expression, box: Box) -> float:
    """The largest magnitude of an expression over the box; 1 where it has no finite bound, or is 0 everywhere."""
    return max(_sides(as_margin(expression), tuple(box.items()))) or 1.0


def as_margin(expression: Expression) -> Predicate:
    """A predicate whose margin is the expression."""
    return Predicate(">=", expression, Number(0.0))


@lru_cache(maxsize=1024)
def _sides(psi: stl.Formula, box: tuple[tuple[str, tuple[float, float]], ...]) -> tuple[float, float]:
    """How far the margin gets above and below 0; 0 where it does not, or where nothing is proven."""
    try:
        bounds = stl.bounds(psi, dict(box), nodes=20_000)
    except stl.UndefinedError:  # it has no value somewhere in the box, as x / y
        return 0.0, 0.0
    high, low = (side if math.isfinite(side) and side > 0 else 0.0 for side in (bounds.high, -bounds.low))
    return high, low
