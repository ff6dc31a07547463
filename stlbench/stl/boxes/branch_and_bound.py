"""The maximum of a function over a box, by interval branch and bound.

Interval arithmetic over-estimates where a signal occurs more than once, and the less so the smaller the box. So the
boxes whose upper ends are highest are split until those are close enough to a value that is reached at some point.
Points only decide what to drop; what is returned is always an interval end.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.boxes.enclosure import Boxes

Floats: TypeAlias = NDArray[np.float64]
#: boxes split at once: enough to hide the interpreter, few enough to stay close to best-first order
BATCH = 64


@dataclass(frozen=True)
class Objective:
    """A function to maximise: interval ends (m,) for m boxes, and values (m,) for m points (m, n)."""

    names: tuple[str, ...]
    upper: Callable[[Boxes], Floats]
    at: Callable[[Floats], Floats]


class Maximum(NamedTuple):
    """The maximum lies in [reached, bound]: `bound` is proven, `reached` is a value at a point, to rounding."""

    bound: float
    reached: float


def maximum(objective: Objective, box: Floats, enough: Callable[[float], float], boxes: int) -> Maximum:
    """Bound the maximum over a box.

    Args:
        objective: what to maximise.
        box: (n, 2), the ends of each signal.
        enough: of the best value reached: what a bound need not be below; boxes under it are not split.
        boxes: how many may be examined.
    """
    low, high = box[None, :, 0], box[None, :, 1]
    widths = np.where(box[:, 1] > box[:, 0], box[:, 1] - box[:, 0], 1.0)
    upper = _upper(objective, low, high)
    reached = _reached(objective, low, high)
    dropped = -np.inf
    examined = 1
    while len(upper) and upper.max() > enough(reached) and examined < boxes:
        best = np.argsort(-upper)[: max(BATCH, len(upper) // 4)]
        new_low, new_high = _split(low[best], high[best], widths)
        if not len(new_low):
            break
        new_upper = np.minimum(_upper(objective, new_low, new_high), np.tile(upper[best], 2))
        reached = max(reached, _reached(objective, new_low, new_high))
        low = np.concatenate([np.delete(low, best, axis=0), new_low])
        high = np.concatenate([np.delete(high, best, axis=0), new_high])
        upper = np.concatenate([np.delete(upper, best), new_upper])
        examined += len(new_upper)
        hopeless = upper <= enough(reached)
        dropped = max(dropped, upper[hopeless].max(initial=-np.inf))
        low, high, upper = low[~hopeless], high[~hopeless], upper[~hopeless]
    return Maximum(float(max(dropped, upper.max(initial=-np.inf))), reached)


def _upper(objective: Objective, low: Floats, high: Floats) -> Floats:
    boxes = {name: (low[:, i], high[:, i]) for i, name in enumerate(objective.names)}
    ends = np.broadcast_to(objective.upper(boxes), low.shape[:1])
    return np.where(np.isnan(ends), np.inf, ends)


def _reached(objective: Objective, low: Floats, high: Floats) -> float:
    """The best of the boxes' middles and two corners."""
    points = np.concatenate([low / 2 + high / 2, low, high])
    return float(np.nanmax(objective.at(points), initial=-np.inf))


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
