"""The regions of conditions within the ranges of the signals: their points, their distances, and which exclude each
other."""

from collections.abc import Callable, Mapping
from functools import lru_cache

import numpy as np

from stlbench import stl
from stlbench.contract import Array
from stlbench.stl import And, Formula
from stlbench.task.forms import Box, scale

_DRAWN, _ROUNDS = 2000, 8
"""Points drawn within the ranges, and the rounds in which they are drawn ever nearer to the best one."""
_KEPT = 64
"""Points of a region by which distances are measured."""
_DEEP = 0.5
"""A point counts where its margin is at least this share of the near size: a robot need not stop at a border."""


class Regions:
    """Distances between conditions over the signals that both read.

    Args:
        box: the ranges of the signals; those of different units are divided by their ranges.
        units: signal -> its unit; the signal's name stands in for none.
        initial: samples (n, k) at the start of episodes, with the columns of `box`.
    """

    def __init__(self, box: Box, units: Mapping[str, str], initial: Array) -> None:
        self.box, self._initial = dict(box), initial
        self._names = tuple(box)
        alike = len({units.get(name) or name for name in box}) == 1
        self._size = np.array([1.0 if alike else max(high - low, 1e-12) for low, high in box.values()])
        # caches of this object: on a method, `lru_cache` would keep every object alive
        self._points: Callable[[Formula], Array | None] = lru_cache(maxsize=None)(self._found)
        self.exclusive: Callable[[Formula, Formula], bool] = lru_cache(maxsize=None)(self._exclusive)
        self.distance: Callable[[Formula | None, Formula], float] = lru_cache(maxsize=None)(self._distance)

    def _columns(self, psi: Formula) -> list[int]:
        return [self._names.index(name) for name in stl.signals(psi)]

    def _found(self, psi: Formula) -> Array | None:
        """Points (m, k) at which a condition holds best; None where none was found."""
        points, margins = _best_points(psi, self.box)
        if margins.max() < 0:
            return None
        # where no point is so deep, as on a border alone, the deepest ones count
        deep = points[margins >= min(_DEEP * scale(psi, self.box).near, margins.max())]
        thinned: Array = deep[:: -(-len(deep) // _KEPT)]
        return thinned

    def _exclusive(self, first: Formula, second: Formula) -> bool:
        """Whether both never hold at once, as far as points that were drawn say."""
        if first == second or not {*stl.signals(first)} & {*stl.signals(second)}:
            return False
        return self._points(And((first, second))) is None

    def possible(self, psi: Formula) -> bool:
        """Whether a condition holds anywhere within the ranges, unless it is proven that it does not."""
        try:
            return self._points(psi) is not None or stl.bounds(psi, self.box, nodes=2000).high >= 0
        except stl.UndefinedError:  # it has no value somewhere within the ranges, as x / y
            return True

    def _between(self, origin: Formula | None, target: Formula) -> list[int]:
        """The columns of the signals that both read; of those of the target from the starts."""
        columns = self._columns(target)
        return columns if origin is None else [column for column in columns if column in self._columns(origin)]

    def steps(self, origin: Formula | None, target: Formula, traces: Array) -> int | None:
        """The fewest steps in which one of some traces (n, steps + 1, k) goes as far as from one condition to another.

        None where none of them ever does. Samples after the end of an episode may be NaN.
        """
        far = self.distance(origin, target)
        scaled = (traces / self._size)[..., self._between(origin, target)]
        for steps in range(1, scaled.shape[1]):
            if np.any(np.linalg.norm(scaled[:, steps:] - scaled[:, :-steps], axis=-1) >= far):
                return steps
        return None

    def _distance(self, origin: Formula | None, target: Formula) -> float:
        """The distance from where one condition holds to where another does; for None from the starts, in the mean.

        It is 0 if one of them holds nowhere, or if they read no signal in common.
        """
        there = self._points(target)
        here = self._initial if origin is None else self._points(origin)
        columns = self._between(origin, target)
        if here is None or there is None or not columns:
            return 0.0
        if origin is None and (stl.margin(target, self._names)(here) >= 0).all():
            return 0.0
        from scipy.spatial.distance import cdist  # which most commands do without

        scaled = [(points / self._size)[:, columns] for points in (here, there)]
        between = cdist(*scaled)
        return float(between.min(axis=1).mean() if origin is None else between.min())


def _best_points(psi: Formula, box: Box) -> tuple[Array, Array]:
    """Points (m, k) and their margins, drawn over all ranges of the signals that count and then nearer to the best."""
    names = tuple(box)
    generator = np.random.default_rng(0)
    low, high = np.array(list(box.values())).T
    read = [names.index(name) for name in stl.signals(psi)]
    points = np.tile((low + high) / 2, (_DRAWN, 1))
    points[:, read] = generator.uniform(low[read], high[read], (_DRAWN, len(read)))
    margin = stl.margin(psi, names)
    margins = np.nan_to_num(margin(points), nan=-np.inf)
    size = (high - low)[read] / 4
    for _ in range(_ROUNDS):
        best = points[int(margins.argmax())]
        near = np.tile(best, (_DRAWN // 8, 1))
        moved = best[read] + size * generator.uniform(-1.0, 1.0, (len(near), len(read)))
        near[:, read] = moved.clip(low[read], high[read])
        points = np.concatenate([points, near])
        margins = np.concatenate([margins, np.nan_to_num(margin(near), nan=-np.inf)])
        size = size / 2
    return points, margins
