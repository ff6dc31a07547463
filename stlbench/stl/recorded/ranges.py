"""Which values a formula can have, by those that its predicates can have."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

from stlbench.stl.language.syntax import Between, Connective, Formula, Predicate, Release, Window
from stlbench.stl.predicates import compile_arrays
from stlbench.stl.predicates.writer import Reading


def value_range(formula: Formula, of: Callable[[Predicate], tuple[float, float]]) -> tuple[float, float]:
    """Sound bounds of the robustness over all traces on which the margin of each predicate is within its bounds `of`.

    A past operator whose interval can lie before step 0 has infinity as one of them.
    """
    match formula:
        case Predicate():
            return of(formula)
        case Connective():
            ranges = (_signed_range(value_range(arg, of), negated) for arg, negated in formula.signed)
            lows, highs = zip(*ranges, strict=True)
            pick = min if formula.least else max
            return pick(lows), pick(highs)
        case Window(a, _, arg):
            low, high = value_range(arg, of)
            if formula.past and a > 0:
                return (low, math.inf) if formula.least else (-math.inf, high)
            return low, high
        case Between(a, _, left, right):
            guard, goal = value_range(left, of), value_range(right, of)
            if isinstance(formula, Release):
                return goal[0], max(goal[1], guard[1])
            return (-math.inf if formula.past and a > 0 else min(goal[0], guard[0])), goal[1]
        case _:
            return math.inf, math.inf


def _signed_range(ends: tuple[float, float], negated: bool) -> tuple[float, float]:
    return (-ends[1], -ends[0]) if negated else ends


@lru_cache(maxsize=512)
def unknown(psi: Formula, names: tuple[str, ...], reading: Reading, worst: bool) -> float:
    """The least (`worst`) or greatest value of `psi` at a sample that is not known yet: infinite unless constant."""

    def bounds(predicate: Predicate) -> tuple[float, float]:
        constant = compile_arrays(predicate, names, reading)
        return (-math.inf, math.inf) if callable(constant) else (float(constant), float(constant))

    return value_range(psi, bounds)[0 if worst else 1]
