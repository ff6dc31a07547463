"""Both extremes of a margin, or of an expression, over a box, with bounded work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from stlbench.stl.boxes.branch_and_bound import Floats, Maximum, Objective, maximum
from stlbench.stl.boxes.enclosure import Boxes, Proven, enclosure
from stlbench.stl.functions.intervals import negative
from stlbench.stl.language.syntax import Expression, Formula, Number, Predicate
from stlbench.stl.predicates.compiler import compile_margin

#: interval operations that one extreme may take: a part of the formula and its derivative by each signal, on one box
WORK = 12_800_000


@dataclass(frozen=True)
class Search:
    """A box, and how its extremes are looked for.

    Attributes:
        ends: of each signal.
        tolerance: of an extreme, absolute.
        boxes: how many may be examined for one extreme; fewer where a box takes much work.
        work: how many interval operations one extreme may take, see `WORK`.
        proven: ranges of arguments that are known so far, see `enclosure`.
    """

    ends: dict[str, tuple[float, float]]
    tolerance: float
    boxes: int
    work: int = WORK
    proven: Proven = field(default_factory=dict)

    def extremes(self, target: Formula | Expression) -> tuple[Maximum, Maximum]:
        """The maximum of the negated margin (value) of `target`, and the maximum of the margin itself."""
        at = self._values(target)
        lowest = self._maximum(target, True, lambda points: -at(points), self._close_enough, self.boxes)
        return lowest, self._maximum(target, False, at, self._close_enough, self.boxes)

    def falls_below(self, target: Expression, least: float, boxes: int) -> bool:
        """Whether some point of the box was found where `target` is provably less than `least`."""

        def at(points: Floats) -> Floats:
            places = {name: (points[:, i], points[:, i]) for i, name in enumerate(self.ends)}
            return np.broadcast_to(-enclosure(target, places, self.proven)[1], points.shape[:1])

        def enough(reached: float) -> float:
            return np.inf if reached > -least else -least

        return self._maximum(target, True, at, enough, boxes).reached > -least

    def _close_enough(self, reached: float) -> float:
        return reached + self.tolerance

    def _maximum(
        self,
        target: Formula | Expression,
        negated: bool,
        at: Callable[[Floats], Floats],
        enough: Callable[[float], float],
        boxes: int,
    ) -> Maximum:
        def upper(places: Boxes) -> Floats:
            range_ = enclosure(target, places, self.proven)
            return (negative(range_) if negated else range_)[1]

        box = np.array(list(self.ends.values()), dtype=float).reshape(-1, 2)
        operations = target.size * (1 + len(self.ends))
        return maximum(Objective(tuple(self.ends), upper, at), box, enough, min(boxes, self.work // operations))

    def _values(self, target: Formula | Expression) -> Callable[[Floats], Floats]:
        """The margin (the value) of `target` at points (m, n)."""
        psi = target if isinstance(target, Formula) else Predicate(">=", target, Number(0.0))
        compiled = compile_margin(psi, tuple(self.ends))

        def at(points: Floats) -> Floats:
            values = compiled(points) if callable(compiled) else compiled
            return np.broadcast_to(np.asarray(values), points.shape[:1])

        return at
