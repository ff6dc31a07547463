"""Curves of several seeds as one: on common steps, their mean with its interval."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.report.statistics.intervals import mean_interval

Array = NDArray[np.float64]
Point = tuple[int, float, float]
"""One checkpoint: its environment steps, and what it scored."""


class MeanCurve(NamedTuple):
    """One line: the mean over seeds at common steps (p,), and the ends of its interval where it has one."""

    steps: Array
    mean: Array
    low: Array
    """(p,): NaN where there is no interval."""
    high: Array
    least: float
    """Of all seeds."""
    most: float


def mean_curve(
    curves: Sequence[Sequence[Point]],
    value: Callable[[Point], float],
    possible: tuple[float, float] = (-np.inf, np.inf),
) -> MeanCurve:
    """The mean of the seeds' curves, with its 95 % t interval where there are two seeds or more.

    The interval ends at what is `possible`, and never between the seeds.
    """
    steps, values = aligned(curves, value)
    ends = [mean_interval(column.tolist()) or (np.nan, np.nan) for column in values.T]
    low, high = np.array(ends, dtype=float).reshape(-1, 2).T
    low = np.maximum(low, np.minimum(possible[0], values.min(axis=0)))
    high = np.minimum(high, np.maximum(possible[1], values.max(axis=0)))
    return MeanCurve(steps, values.mean(axis=0), low, high, float(values.min()), float(values.max()))


def aligned(curves: Sequence[Sequence[Point]], value: Callable[[Point], float]) -> tuple[Array, Array]:
    """Curves on common steps: (p,) and (seeds, p), where seeds took checkpoints at other steps linearly interpolated.

    The common steps end where the shortest curve does and begin where the latest one does.
    """
    begin, end = max(curve[0][0] for curve in curves), min(curve[-1][0] for curve in curves)
    steps = np.array(sorted({point[0] for curve in curves for point in curve if begin <= point[0] <= end}), dtype=float)
    values = [np.interp(steps, [point[0] for point in curve], [value(point) for point in curve]) for curve in curves]
    return steps, np.array(values)
