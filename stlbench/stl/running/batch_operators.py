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
from stlbench.stl.predicates.compiler import compile_signed
from stlbench.stl.recorded.evaluator import cause
from stlbench.stl.running.operator_tree import Ends, Interval, Kit, Leaf, Pointwise
from stlbench.stl.running.unfolding import Found, Kept, Recent, Unfolding

Floats: TypeAlias = NDArray[np.float64]
Steps: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]
#: the value of a Pointwise: (samples (n, k), which of them are asked about) -> signed values (n,)
Psi: TypeAlias = Callable[[Floats, Mask], Floats]
#: a mask or indices of traces
Which: TypeAlias = Any


class Operator(Leaf):
    """A leaf that takes the samples of `count` traces; `initial` are its bounds before the first."""

    def __init__(self, count: int, start: int, stop: int, initial: Ends, flipped: bool) -> None:
        super().__init__(start, stop, flipped)
        self.initial = initial
        self.ends: Ends = np.full(count, initial[0]), np.full(count, initial[1])

    def read(self, now: Steps, samples: Floats) -> Any:
        """What `take` needs of the next samples (n, k): changes nothing, and raises UndefinedError with the trace."""
        raise NotImplementedError

    def take(self, now: Steps, value: Any) -> None:
        """Count what was read."""
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

    def __init__(self, count: int, psi: Pointwise, interval: Interval, unknown: Ends, flipped: bool) -> None:
        super().__init__(count, *interval, unknown, flipped)
        self.psi, self.unknown = psi, unknown
        self.least = np.full(count, np.inf)

    def read(self, now: Steps, samples: Floats) -> Floats:
        """The values of psi."""
        values: Floats = self.psi.value(samples, self.within(now))
        return values

    def take(self, now: Steps, value: Floats) -> None:
        """Count the values of psi."""
        active = self.within(now)
        np.minimum(self.least, value, out=self.least, where=active)
        for end, unknown in zip(self.ends, self.unknown, strict=True):
            np.copyto(end, np.where(now < self.stop, np.minimum(self.least, unknown), self.least), where=active)

    def restart(self, which: Which) -> None:
        """Forget the samples of some traces."""
        super().restart(which)
        self.least[which] = np.inf


class Nested(Operator):
    """F[a,c] G[d,e] psi."""

    def __init__(
        self, count: int, psi: Pointwise, outer: Interval, inner: Interval, unknown: Ends, flipped: bool
    ) -> None:
        (a, c), (d, e) = outer, inner
        super().__init__(count, a + d, c + e, unknown, flipped)
        self.psi, self.unknown = psi, unknown
        self.first, self.last = a + e, c + d
        self.window = SlidingLeast(count, e - d + 1)
        self.best, self.open = np.full(count, -np.inf), np.full(count, np.inf)

    def read(self, now: Steps, samples: Floats) -> Floats:
        """The values of psi."""
        values: Floats = self.psi.value(samples, self.within(now))
        return values

    def take(self, now: Steps, value: Floats) -> None:
        """Count the values of psi. All windows slide together: one that counts lies within a single run of a trace."""
        active = self.within(now)
        np.maximum(self.best, self.window.step(value), out=self.best, where=active & (now >= self.first))
        np.minimum(self.open, value, out=self.open, where=active & (now >= self.last))
        for end, unknown in zip(self.ends, self.unknown, strict=True):
            ahead = np.where(now < self.stop, np.minimum(self.open, unknown), -np.inf)
            np.maximum(self.best, ahead, out=end, where=active)

    def restart(self, which: Which) -> None:
        """Forget the samples of some traces."""
        super().restart(which)
        self.best[which], self.open[which] = -np.inf, np.inf


class SlidingLeast:
    """Minimum of the last `width` samples, in constant amortised work and `width` samples of memory per trace.

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
        self,
        count: int,
        psis: tuple[Pointwise, Pointwise],
        interval: Interval,
        unknowns: tuple[Ends, Ends],
        flipped: bool,
    ) -> None:
        a, b = interval
        super().__init__(count, 0, b, (-np.inf, np.inf), flipped)
        self.a, self.unknowns = a, unknowns
        self.left, self.right = psis
        self.best, self.guard = np.full(count, -np.inf), np.full(count, np.inf)

    def read(self, now: Steps, samples: Floats) -> tuple[Floats, Floats]:
        """The values of left and of right."""
        left: Floats = self.left.value(samples, now < self.stop)
        right: Floats = self.right.value(samples, self.within(now) & (now >= self.a))
        return left, right

    def take(self, now: Steps, value: tuple[Floats, Floats]) -> None:
        """Count the values of left and of right."""
        guard, goal = value
        active, before = self.within(now), now < self.stop
        np.maximum(self.best, np.minimum(goal, self.guard), out=self.best, where=active & (now >= self.a))
        np.minimum(self.guard, guard, out=self.guard, where=before)
        for end, left, right in zip(self.ends, *self.unknowns, strict=True):
            ahead = np.minimum(self.guard, np.where(now >= self.a - 1, right, min(left, right)))
            np.maximum(self.best, np.where(before, ahead, -np.inf), out=end, where=active)

    def restart(self, which: Which) -> None:
        """Forget the samples of some traces."""
        super().restart(which)
        self.best[which], self.guard[which] = -np.inf, np.inf


class Replayed(Operator):
    """Any other formula: evaluates what is not decided at each step, traces of one age together."""

    def __init__(self, count: int, formula: Formula, names: tuple[str, ...], negated: bool) -> None:
        self.until = Unfolding(formula, names)
        super().__init__(count, 0, self.until.last, (-np.inf, np.inf), self.until.flipped is not negated)
        self.samples, kept = Recent(count, len(names)), self.until.begin(count)
        self.kept = kept._replace(before={node: np.empty(count) for node in self.until.carried})

    def read(self, now: Steps, samples: Floats) -> list[tuple[Steps, Found]]:
        """What is known of the traces of each age."""
        rows, found = np.flatnonzero(self.within(now)), list[tuple[Steps, Found]]()
        for age in np.unique(now[rows]).tolist():
            same = rows[now[rows] == age]
            known = self.samples.with_newest(samples, min(age + 1, self.until.window))[same]
            try:
                found.append((same, self.until.read(known, age, _of(self.kept, same))))
            except UndefinedError as error:
                raise UndefinedError(error.what, trace=int(same[error.trace or 0])) from None
        return found

    def take(self, now: Steps, value: list[tuple[Steps, Found]]) -> None:
        """Keep the samples."""
        self.samples.take(min(int(now.max()) + 1, self.until.window))
        for same, found in value:
            for end, new in zip(self.ends, (found.lower, found.upper), strict=True):
                end[same] = new
            self.kept.best[same], self.kept.guard[same] = found.kept.best, found.kept.guard
            for node, values in found.kept.before.items():
                self.kept.before[node][same] = values

    def restart(self, which: Which) -> None:
        """Forget the samples of some traces."""
        super().restart(which)
        self.kept.best[which], self.kept.guard[which] = -np.inf, np.inf


def _of(kept: Kept, rows: Steps) -> Kept:
    return Kept(kept.best[rows], kept.guard[rows], {node: values[rows] for node, values in kept.before.items()})


def many(count: int) -> Kit[Operator]:
    """The operators for `count` traces."""
    operators = [partial(operator, count) for operator in (Lowest, Nested, Until, Replayed)]
    return Kit(np.minimum.reduce, np.maximum.reduce, _compile, *operators)


def _compile(psi: Formula, names: tuple[str, ...], negated: bool) -> Psi:
    compiled = compile_signed(Not(psi) if negated else psi, names)
    if not callable(compiled):
        return lambda samples, asked: np.full(len(samples), compiled)

    def run(samples: Floats, asked: Mask) -> Floats:
        values: Floats = compiled(samples)
        wrong = np.isnan(values)
        if wrong.any() and (wrong & asked).any():
            trace = int((wrong & asked).argmax())
            raise UndefinedError(cause(psi, names, samples[trace]), trace=trace)
        return values

    return run
