"""Operators of the online monitor for one trace, on plain floats: for one sample many times faster than NumPy."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Any, TypeAlias

from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates.compiler import Sample, compile_sample, compile_signed
from stlbench.stl.recorded.evaluation import evaluate
from stlbench.stl.running.operator_tree import Kit, Leaf, Pointwise

Bounds: TypeAlias = tuple[float, float]


class Operator(Leaf):
    """A leaf that takes the samples of one trace."""

    @property
    def turns(self) -> tuple[int, ...]:
        """The steps from which on something else is read than before."""
        return self.start, self.stop + 1

    def asks(self, now: int) -> tuple[Pointwise, ...]:
        """What is asked of the sample of step `now` in start..stop; the same until the next turn."""
        raise NotImplementedError

    def reader(self, now: int) -> Callable[[Sample], Any]:
        """What reads that sample for `take`: changes nothing, and raises UndefinedError where there is no value."""
        psis = self.asks(now)
        if len(psis) == 1:
            read: Callable[[Sample], Any] = psis[0].value
            return read
        first, second = (psi.value for psi in psis)
        return lambda sample: (first(sample), second(sample))

    def take(self, now: int, value: Any) -> bool:
        """Count what was read at step `now`; whether `ends` may have changed."""
        raise NotImplementedError


class Lowest(Operator):
    """G[a,b] psi: one running minimum. `unknown` bounds psi at a sample that has not come yet."""

    def __init__(self, psi: Pointwise, interval: tuple[int, int], unknown: Bounds, flipped: bool) -> None:
        super().__init__(*interval, flipped)
        self.psi, self.unknown = psi, unknown
        self.least = math.inf
        self.ends = unknown

    def asks(self, now: int) -> tuple[Pointwise, ...]:
        """Psi, at every step."""
        return (self.psi,)

    def take(self, now: int, value: Any) -> bool:
        """Count the value of psi."""
        if value < self.least:
            self.least = value
        elif now < self.stop:
            return False
        least, (lower, upper) = self.least, self.unknown
        self.ends = (least, least) if now == self.stop else (min(least, lower), min(least, upper))
        return True


class Nested(Operator):
    """F[a,c] G[d,e] psi: a queue of the samples that can still be a window's minimum, constant amortised work.

    Windows that are complete count as they are. An incomplete window can only lose what its seen part already lost,
    and the seen parts shrink as t grows, so of those the last window, t = c, decides alone.
    """

    def __init__(
        self, psi: Pointwise, outer: tuple[int, int], inner: tuple[int, int], unknown: Bounds, flipped: bool
    ) -> None:
        (a, c), (d, e) = outer, inner
        super().__init__(a + d, c + e, flipped)
        self.psi, self.unknown = psi, unknown
        self.first, self.last, self.width = a + e, c + d, e - d
        self.best, self.open = -math.inf, math.inf  # of the complete windows; of the last one as far as seen
        self.queue: deque[tuple[int, float]] = deque()  # times and values, both rising
        self.ends = unknown

    def asks(self, now: int) -> tuple[Pointwise, ...]:
        """Psi, at every step."""
        return (self.psi,)

    def take(self, now: int, value: Any) -> bool:
        """Count the value of psi."""
        queue = self.queue
        while queue and queue[-1][1] >= value:
            queue.pop()
        queue.append((now, value))
        changed = now == self.stop
        if now >= self.first:
            if queue[0][0] < now - self.width:
                queue.popleft()
            if queue[0][1] > self.best:
                self.best = queue[0][1]
                changed = True
        if now >= self.last and value < self.open:
            self.open = value
            changed = True
        if changed:
            best, (lower, upper) = self.best, self.unknown
            ahead = (best, best) if now == self.stop else (min(self.open, lower), min(self.open, upper))
            self.ends = max(best, ahead[0]), max(best, ahead[1])
        return changed


class Until(Operator):
    """left U[a,b] right: the minimum of left so far and the best of right within it."""

    def __init__(
        self,
        psis: tuple[Pointwise, Pointwise],
        interval: tuple[int, int],
        unknowns: tuple[Bounds, Bounds],
        flipped: bool,
    ) -> None:
        super().__init__(0, interval[1], flipped)
        self.left, self.right = psis
        self.a = interval[0]
        self.changes = {0, self.a - 1, self.stop}  # where the bounds change of themselves
        self.lows, self.highs = zip(*unknowns, strict=True)  # of left and of right
        self.best, self.guard = -math.inf, math.inf
        self.ends = -math.inf, math.inf

    @property
    def turns(self) -> tuple[int, ...]:
        """Left is read before the end of the interval, right within it."""
        return self.start, self.a, self.stop, self.stop + 1

    def asks(self, now: int) -> tuple[Pointwise, ...]:
        """Left, right or both."""
        return (self.left,) * (now < self.stop) + (self.right,) * (now >= self.a)

    def take(self, now: int, value: Any) -> bool:
        """Count the values of left and right."""
        changed = now in self.changes
        if now >= self.a:
            if now < self.stop:
                value, goal = value
            else:
                goal = value
            goal = goal if goal < self.guard else self.guard
            if goal > self.best:
                self.best = goal
                changed = True
        if now < self.stop and value < self.guard:
            self.guard = value
            changed = True
        if changed:
            self.ends = self._end(now, *self.lows), self._end(now, *self.highs)
        return changed

    def _end(self, now: int, left: float, right: float) -> float:
        """With the values that left and right take from now on: the next t' is the best of those ahead."""
        if now == self.stop:
            return self.best
        ahead = right if now >= self.a - 1 or right < left else left
        ahead = ahead if ahead < self.guard else self.guard
        return ahead if ahead > self.best else self.best


class Replayed(Operator):
    """Any other formula: keeps the samples that it may still read and evaluates them again at each step."""

    def __init__(self, formula: Formula, names: tuple[str, ...], last: int) -> None:
        super().__init__(0, last, False)
        self.formula, self.names = formula, names
        self.samples: list[Sample] = []
        self.ends = -math.inf, math.inf

    def asks(self, now: int) -> tuple[Pointwise, ...]:
        """Nothing by itself: the evaluation says where it fails."""
        return ()

    def reader(self, now: int) -> Callable[[Sample], Any]:
        """The bounds with one more sample."""
        return self._read

    def _read(self, sample: Sample) -> tuple[Sample, float, float]:
        sample = tuple(sample)
        known = [*self.samples, sample]
        lower, upper = evaluate(compile_signed, self.formula, known, self.names, "interval", full=False)
        return sample, lower.item(), upper.item()

    def take(self, now: int, value: Any) -> bool:
        """Keep the sample."""
        sample, lower, upper = value
        self.samples.append(sample)
        self.ends = lower, upper
        return True


ONE = Kit(min, max, compile_sample, Lowest, Nested, Until, Replayed)
