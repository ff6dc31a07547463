"""Operators of the online monitor for many traces: one NumPy call where `scalar_operators` has a number.

Arrays are (n,), one value per trace. Each trace has its own clock, and `now` are the clocks; traces whose clock lies
outside start..stop are carried along and do not change.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.errors import UndefinedError
from stlbench.stl.language.syntax import Formula, Not
from stlbench.stl.predicates.compiler import compile_sided
from stlbench.stl.running import scalar_operators
from stlbench.stl.running.operator_tree import Ends, Interval, Kit, Leaf

Floats: TypeAlias = NDArray[np.float64]
Steps: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]
#: (samples (n, k), which of them are asked about) -> sided values (n,)
Psi: TypeAlias = Callable[[Floats, Mask], Floats]
#: a mask or indices of traces
Which: TypeAlias = Any


class Operator(Leaf):
    """A leaf that takes the samples of `count` traces; `initial` are its bounds before the first."""

    def __init__(self, count: int, start: int, stop: int, initial: Ends, flipped: bool) -> None:
        super().__init__(start, stop, flipped)
        self.initial = initial
        self.ends: Ends = np.full(count, initial[0]), np.full(count, initial[1])

    def step(self, now: Steps, samples: Floats) -> None:
        """Take the next samples (n, k)."""
        raise NotImplementedError

    def restart(self, which: Which) -> None:
        """Forget the samples of some traces."""
        for end, value in zip(self.ends, self.initial, strict=True):
            end[which] = value

    def within(self, now: Steps) -> Mask:
        """The traces that this leaf reads at their steps `now`."""
        mask: Mask = (now >= self.start) & (now <= self.stop)
        return mask


class Lowest(Operator):
    """G[a,b] psi."""

    def __init__(self, count: int, psi: Psi, interval: Interval, unknown: Ends, flipped: bool) -> None:
        super().__init__(count, *interval, unknown, flipped)
        self.psi, self.unknown = psi, unknown
        self.least = np.full(count, np.inf)

    def step(self, now: Steps, samples: Floats) -> None:
        """Take the next samples."""
        active = self.within(now)
        np.minimum(self.least, self.psi(samples, active), out=self.least, where=active)
        for end, value in zip(self.ends, self.unknown, strict=True):
            np.copyto(end, np.where(now < self.stop, np.minimum(self.least, value), self.least), where=active)

    def restart(self, which: Which) -> None:
        """Forget the samples of some traces."""
        super().restart(which)
        self.least[which] = np.inf


class Nested(Operator):
    """F[a,c] G[d,e] psi."""

    def __init__(self, count: int, psi: Psi, outer: Interval, inner: Interval, unknown: Ends, flipped: bool) -> None:
        (a, c), (d, e) = outer, inner
        super().__init__(count, a + d, c + e, unknown, flipped)
        self.psi, self.unknown = psi, unknown
        self.first, self.last = a + e, c + d
        self.window = SlidingLeast(count, e - d + 1)
        self.best, self.open = np.full(count, -np.inf), np.full(count, np.inf)

    def step(self, now: Steps, samples: Floats) -> None:
        """Take the next samples. All windows slide together: one that counts lies within a single run of a trace."""
        active = self.within(now)
        values = self.psi(samples, active)
        np.maximum(self.best, self.window.step(values), out=self.best, where=active & (now >= self.first))
        np.minimum(self.open, values, out=self.open, where=active & (now >= self.last))
        for end, value in zip(self.ends, self.unknown, strict=True):
            ahead = np.where(now < self.stop, np.minimum(self.open, value), -np.inf)
            np.maximum(self.best, ahead, out=end, where=active)

    def restart(self, which: Which) -> None:
        """Forget the samples of some traces."""
        super().restart(which)
        self.best[which], self.open[which] = -np.inf, np.inf


class SlidingLeast:
    """Minimum of the last `width` samples, in constant amortised work and `width` samples of memory a trace.

    Samples come in blocks of `width`. A window is the end of the block before, whose minima to its end were worked out
    when it was full, and the beginning of this block, whose minimum is kept as it grows.
    """

    def __init__(self, count: int, width: int) -> None:
        self.rows = np.full((width, count), np.inf)
        self.beginning = np.full(count, np.inf)
        self.at = 0

    def step(self, values: Floats) -> Floats:
        """Take (n,), return the minima of the last `width`; means nothing before as many were taken."""
        self.beginning = np.minimum(self.beginning, values) if self.at else values
        self.rows[self.at] = values
        self.at += 1
        if self.at < len(self.rows):
            least: Floats = np.minimum(self.beginning, self.rows[self.at])
            return least
        self.at = 0
        self.rows = np.minimum.accumulate(self.rows[::-1], axis=0)[::-1]
        return self.beginning


class Until(Operator):
    """left U[a,b] right."""

    def __init__(
        self, count: int, psis: tuple[Psi, Psi], interval: Interval, unknowns: tuple[Ends, Ends], flipped: bool
    ) -> None:
        a, b = interval
        super().__init__(count, 0, b, (-np.inf, np.inf), flipped)
        self.a, self.unknowns = a, unknowns
        self.left, self.right = psis
        self.best, self.guard = np.full(count, -np.inf), np.full(count, np.inf)

    def step(self, now: Steps, samples: Floats) -> None:
        """Take the next samples."""
        active = self.within(now)
        goal, before = active & (now >= self.a), now < self.stop
        reached = np.minimum(self.right(samples, goal), self.guard)
        np.maximum(self.best, reached, out=self.best, where=goal)
        np.minimum(self.guard, self.left(samples, before), out=self.guard, where=before)
        for end, left, right in zip(self.ends, *self.unknowns, strict=True):
            ahead = np.minimum(self.guard, np.where(now >= self.a - 1, right, min(left, right)))
            np.maximum(self.best, np.where(before, ahead, -np.inf), out=end, where=active)

    def restart(self, which: Which) -> None:
        """Forget the samples of some traces."""
        super().restart(which)
        self.best[which], self.guard[which] = -np.inf, np.inf


class Replayed(Operator):
    """Any other formula, trace by trace as `scalar_operators` does it."""

    def __init__(self, count: int, formula: Formula, names: tuple[str, ...], horizon: int) -> None:
        super().__init__(count, 0, horizon, (-np.inf, np.inf), False)
        self.fresh = partial(scalar_operators.Replayed, formula, names, horizon)
        self.traces = [self.fresh() for _ in range(count)]

    def step(self, now: Steps, samples: Floats) -> None:
        """Take the next samples."""
        for i in np.flatnonzero(self.within(now)):
            self.traces[i].step(int(now[i]), samples[i].tolist())
            self.ends[0][i], self.ends[1][i] = self.traces[i].ends

    def restart(self, which: Which) -> None:
        """Forget the samples of some traces."""
        super().restart(which)
        for i in np.arange(len(self.traces))[which]:
            self.traces[i] = self.fresh()


def many(count: int) -> Kit[Operator]:
    """The operators for `count` traces."""
    operators = [partial(operator, count) for operator in (Lowest, Nested, Until, Replayed)]
    return Kit(np.minimum.reduce, np.maximum.reduce, _compile, *operators)


def _compile(psi: Formula, names: tuple[str, ...], negated: bool) -> Psi:
    compiled = compile_sided(Not(psi) if negated else psi, names)
    if not callable(compiled):
        return lambda samples, asked: np.full(len(samples), compiled)

    def run(samples: Floats, asked: Mask) -> Floats:
        values: Floats = compiled(samples)
        wrong = np.isnan(values)
        if wrong.any() and (wrong & asked).any():
            trace = int((wrong & asked).argmax())
            sample = dict(zip(names, samples[trace].tolist(), strict=True))
            raise UndefinedError(f"{psi} has no value at {sample} of trace {trace}")
        return values

    return run
