"""Operators of the online monitor for one trace, on plain floats: for one sample many times faster than NumPy."""

from __future__ import annotations

import math
from collections import deque
from typing import TypeAlias

from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates.scalars import Psi, Sample, compile_scalar
from stlbench.stl.recorded.evaluator import SIDED
from stlbench.stl.recorded.robustness import evaluate
from stlbench.stl.running.operator_tree import Kit, Leaf

Bounds: TypeAlias = tuple[float, float]


class Operator(Leaf):
    """A leaf that takes the samples of one trace."""

    def step(self, now: int, sample: Sample) -> bool:
        """Take the sample of step `now` in start..stop; whether `ends` may have changed."""
        raise NotImplementedError


class Lowest(Operator):
    """G[a,b] psi: one running minimum. `unknown` bounds psi at a sample that has not come yet."""

    def __init__(self, psi: Psi, interval: tuple[int, int], unknown: Bounds, flipped: bool) -> None:
        super().__init__(*interval, flipped)
        self.psi, self.unknown = psi, unknown
        self.least = math.inf
        self.ends = unknown

    def step(self, now: int, sample: Sample) -> bool:
        """Take the next sample."""
        value = self.psi(sample)
        if value < self.least:
            self.least = value
        elif now < self.stop:
            return False
        least, (lower, upper) = self.least, self.unknown
        self.ends = (least, least) if now == self.stop else (min(least, lower), min(least, upper))
        return True


class Nested(Operator):
    """F[a,c] G[d,e] psi: a queue of the samples that can still be a window's minimum, constant amortised work a step.

    Windows that are complete count as they are. An incomplete window can only lose what its seen part already lost,
    and the seen parts shrink as t grows, so of those the last window, t = c, decides alone.
    """

    def __init__(
        self, psi: Psi, outer: tuple[int, int], inner: tuple[int, int], unknown: Bounds, flipped: bool
    ) -> None:
        (a, c), (d, e) = outer, inner
        super().__init__(a + d, c + e, flipped)
        self.psi, self.unknown = psi, unknown
        self.first, self.last, self.width = a + e, c + d, e - d
        self.best, self.open = -math.inf, math.inf  # of the complete windows; of the last one as far as seen
        self.queue: deque[tuple[int, float]] = deque()  # times and values, both rising
        self.ends = unknown

    def step(self, now: int, sample: Sample) -> bool:
        """Take the next sample."""
        value = self.psi(sample)
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
        self, psis: tuple[Psi, Psi], interval: tuple[int, int], unknowns: tuple[Bounds, Bounds], flipped: bool
    ) -> None:
        super().__init__(0, interval[1], flipped)
        self.left, self.right = psis
        self.a = interval[0]
        self.turns = {0, self.a - 1, self.stop}  # where the bounds change of themselves
        self.lows, self.highs = zip(*unknowns, strict=True)  # of left and of right
        self.best, self.guard = -math.inf, math.inf
        self.ends = -math.inf, math.inf

    def step(self, now: int, sample: Sample) -> bool:
        """Take the next sample."""
        changed = now in self.turns
        if now >= self.a:
            value = self.right(sample)
            value = value if value < self.guard else self.guard
            if value > self.best:
                self.best = value
                changed = True
        if now < self.stop:
            value = self.left(sample)
            if value < self.guard:
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
    """Any other formula: keeps at most horizon + 1 samples and evaluates them anew at each step (work: the horizon)."""

    def __init__(self, formula: Formula, names: tuple[str, ...], horizon: int) -> None:
        super().__init__(0, horizon, False)
        self.formula, self.names = formula, names
        self.samples: list[Sample] = []

    def step(self, now: int, sample: Sample) -> bool:
        """Take the next sample."""
        self.samples.append(tuple(sample))
        lower, upper = evaluate(SIDED, self.formula, self.samples, self.names, "interval", full=False)
        self.ends = lower.item(), upper.item()
        return True


ONE = Kit(min, max, compile_scalar, Lowest, Nested, Until, Replayed)
