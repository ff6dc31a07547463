"""Both extremes of a margin, or of an expression, over a box, by interval branch and bound with bounded work.

Interval arithmetic over-estimates where a signal occurs more than once, and the less so the smaller the box. So the
boxes whose upper ends are highest are split until those are close enough to a value that is reached at some point.
Points only decide what to drop; the result is always an interval end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.boxes.enclosure import Boxes, Proven, enclosure
from stlbench.stl.language.expressions import Expression, Number
from stlbench.stl.language.syntax import Formula, Predicate
from stlbench.stl.predicates import compile_arrays

Floats: TypeAlias = NDArray[np.float64]
#: boxes split at once: enough to hide the interpreter, few enough to stay close to best-first order
BATCH = 64
#: interval operations that one extreme may take: a part of the formula and its derivative by each signal, on one box
WORK = 12_800_000


class Maximum(NamedTuple):
    """The maximum lies in [reached, bound]: `bound` is proven, `reached` is a value at a point, to rounding."""

    bound: float
    reached: float


@dataclass(frozen=True)
class Search:
    """A box, and the work that may be spent on its extremes."""

    ends: dict[str, tuple[float, float]]  # of each signal
    tolerance: float  # of an extreme, absolute
    boxes: int  # how many may be examined for one extreme; fewer where a box takes much work
    work: int = WORK  # how many interval operations one extreme may take
    proven: Proven = field(default_factory=dict)  # ranges of arguments that are known so far

    def extremes(self, target: Formula | Expression) -> tuple[Maximum, Maximum]:
        """The maximum of the negated margin (value) of `target`, and the maximum of the margin itself."""
        psi = target if isinstance(target, Formula) else Predicate(">=", target, Number(0.0))
        compiled = compile_arrays(psi, tuple(self.ends), "margin")

        def at(points: Floats) -> Floats:
            values = compiled(points) if callable(compiled) else compiled
            return np.broadcast_to(np.asarray(values), points.shape[:1])

        def enough(reached: float) -> float:
            return reached + self.tolerance

        lowest = self._maximum(target, True, lambda points: -at(points), enough, self.boxes)
        return lowest, self._maximum(target, False, at, enough, self.boxes)

    def falls_below(self, target: Expression, least: float, boxes: int) -> bool:
        """Whether some point of the box was found where `target` is provably less than `least`."""

        def at(points: Floats) -> Floats:
            ends = enclosure(target, self._named(points, points), self.proven)
            return np.broadcast_to(-ends[1], points.shape[:1])

        def enough(reached: float) -> float:
            return np.inf if reached > -least else -least

        return self._maximum(target, True, at, enough, boxes).reached > -least

    def _maximum(
        self,
        target: Formula | Expression,
        negated: bool,
        at: Callable[[Floats], Floats],
        enough: Callable[[float], float],
        boxes: int,
    ) -> Maximum:
        """Bound the maximum of (negated) `target`, which is `at` at points (m, n).

        A bound need not be below `enough` of the best value reached: boxes under it are not split.
        """

        def upper_ends(low: Floats, high: Floats) -> Floats:
            ends = enclosure(target, self._named(low, high), self.proven)
            upper = np.broadcast_to(-ends[0] if negated else ends[1], low.shape[:1])
            return np.where(np.isnan(upper), np.inf, upper)

        def best_point(low: Floats, high: Floats) -> float:
            points = np.concatenate([low / 2 + high / 2, low, high])
            return float(np.nanmax(at(points), initial=-np.inf))

        boxes = min(boxes, self.work // (target.size * (1 + len(self.ends))))
        box = np.array(list(self.ends.values()), dtype=float).reshape(-1, 2)
        low, high = box[None, :, 0], box[None, :, 1]
        widths = np.where(box[:, 1] > box[:, 0], box[:, 1] - box[:, 0], 1.0)
        upper, reached = upper_ends(low, high), best_point(low, high)
        dropped, examined = -np.inf, 1
        while len(upper) and upper.max() > enough(reached) and examined < boxes:
            best = np.argsort(-upper)[: max(BATCH, len(upper) // 4)]
            new_low, new_high = _split(low[best], high[best], widths)
            if not len(new_low):
                break
            new_upper = np.minimum(upper_ends(new_low, new_high), np.tile(upper[best], 2))
            reached = max(reached, best_point(new_low, new_high))
            low = np.concatenate([np.delete(low, best, axis=0), new_low])
            high = np.concatenate([np.delete(high, best, axis=0), new_high])
            upper = np.concatenate([np.delete(upper, best), new_upper])
            examined += len(new_upper)
            hopeless = upper <= enough(reached)
            dropped = max(dropped, upper[hopeless].max(initial=-np.inf))
            low, high, upper = low[~hopeless], high[~hopeless], upper[~hopeless]
        return Maximum(float(max(dropped, upper.max(initial=-np.inf))), reached)

    def _named(self, low: Floats, high: Floats) -> Boxes:
        return {name: (low[:, i], high[:, i]) for i, name in enumerate(self.ends)}


def _split(low: Floats, high: Floats, widths: Floats) -> tuple[Floats, Floats]:
    """Both halves of each box, cut across the side that is longest in units of the whole box."""
    if low.shape[1] == 0:
        return low[:0], high[:0]
    side = np.argmax((high - low) / widths, axis=1)
    rows = np.arange(len(low))
    middle = low[rows, side] / 2 + high[rows, side] / 2
    first_high, second_low = high.copy(), low.copy()
    first_high[rows, side] = middle
    second_low[rows, side] = middle
    return np.concatenate([low, second_low]), np.concatenate([first_high, high])
