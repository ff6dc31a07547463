"""Operators of the online monitor: each takes samples one by one and keeps bounds of its formula's value at t = 0.

They work on plain Python numbers (floats for robustness, bools for verdicts: `min` is "and", `max` is "or"), because
for one sample at a time that is many times faster than NumPy.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Protocol, TypeAlias

Value: TypeAlias = float
Bounds: TypeAlias = tuple[Value, Value]
Psi: TypeAlias = Callable[[list[float]], Value]
#: min or max
Pick: TypeAlias = Callable[..., Value]


class Online(Protocol):
    """One operator: `step` takes the next sample and returns (lower, upper) at t = 0."""

    def step(self, sample: list[float]) -> Bounds:
        """Bounds over all continuations of the samples so far."""


class Now:
    """psi at t = 0: known from the first sample on."""

    def __init__(self, psi: Psi) -> None:
        self.psi = psi
        self.value: Value | None = None

    def step(self, sample: list[float]) -> Bounds:
        """Take the next sample."""
        if self.value is None:
            self.value = self.psi(sample)
        return self.value, self.value


class Window:
    """G[a,b] psi (`pick` = min) or F[a,b] psi (max): one running minimum or maximum, constant work a step.

    `empty` is the value of an empty window, `unknown` the bounds of psi at a sample that has not come yet.
    """

    def __init__(self, psi: Psi, interval: tuple[int, int], pick: Pick, empty: Value, unknown: Bounds) -> None:
        self.psi, self.pick, self.unknown = psi, pick, unknown
        self.a, self.b = interval
        self.extreme = empty
        self.now = -1

    def step(self, sample: list[float]) -> Bounds:
        """Take the next sample."""
        self.now += 1
        if self.a <= self.now <= self.b:
            self.extreme = self.pick(self.extreme, self.psi(sample))
        if self.now >= self.b:
            return self.extreme, self.extreme
        return self.pick(self.extreme, self.unknown[0]), self.pick(self.extreme, self.unknown[1])


class Nested:
    """F[a,c] G[d,e] psi (picks max, min) or G[a,c] F[d,e] psi (min, max): one monotone wedge, constant work a step.

    For F G: windows that are complete count as they are. An incomplete window can only lose what its seen part already
    lost, and the seen parts shrink as t grows, so of those the last window, t = c, decides alone. `empties` are the
    values of an empty F and an empty G window, in the order of the operators.
    """

    def __init__(
        self,
        psi: Psi,
        intervals: tuple[tuple[int, int], tuple[int, int]],
        picks: tuple[Pick, Pick],
        empties: tuple[Value, Value],
        unknown: Bounds,
    ) -> None:
        self.psi, self.unknown = psi, unknown
        (self.a, self.c), (self.d, self.e) = intervals
        self.outer_pick, self.inner_pick = picks
        self.settled, self.open = empties  # over the complete windows; of the last window as far as seen
        self.wedge: deque[tuple[int, Value]] = deque()
        self.now = -1

    def step(self, sample: list[float]) -> Bounds:
        """Take the next sample."""
        self.now += 1
        if self.a + self.d <= self.now <= self.c + self.e:
            self._observe(self.psi(sample))
        if self.now >= self.c + self.e:
            return self.settled, self.settled
        lower, upper = (self.inner_pick(self.open, end) for end in self.unknown)
        return self.outer_pick(self.settled, lower), self.outer_pick(self.settled, upper)

    def _observe(self, value: Value) -> None:
        while self.wedge and self.inner_pick(value, self.wedge[-1][1]) == value:
            self.wedge.pop()  # the newer value outlives and beats the older
        self.wedge.append((self.now, value))
        start = self.now - self.e  # of the window that this sample completes
        if start >= self.a:
            while self.wedge[0][0] < start + self.d:
                self.wedge.popleft()
            self.settled = self.outer_pick(self.settled, self.wedge[0][1])
        if self.now >= self.c + self.d:
            self.open = self.inner_pick(self.open, value)


class Joined:
    """Conjunction (`pick` = min) or disjunction (max): bounds combine end by end."""

    def __init__(self, parts: list[Online], pick: Pick) -> None:
        self.parts, self.pick = parts, pick

    def step(self, sample: list[float]) -> Bounds:
        """Take the next sample."""
        lowers, uppers = zip(*[part.step(sample) for part in self.parts], strict=True)
        return self.pick(lowers), self.pick(uppers)


class Negated:
    """Negation swaps the ends."""

    def __init__(self, part: Online, negate: Callable[[Value], Value]) -> None:
        self.part, self.negate = part, negate

    def step(self, sample: list[float]) -> Bounds:
        """Take the next sample."""
        lower, upper = self.part.step(sample)
        return self.negate(upper), self.negate(lower)


class Replayed:
    """Any other formula: keeps at most horizon + 1 samples and evaluates them anew at each step (work: the horizon).

    `evaluate` maps the samples so far to bounds; from the last of them on the answer stands.
    """

    def __init__(self, evaluate: Callable[[list[list[float]]], Bounds], horizon: int) -> None:
        self.evaluate, self.horizon = evaluate, horizon
        self.samples: list[list[float]] = []
        self.answer: Bounds = (-math.inf, math.inf)

    def step(self, sample: list[float]) -> Bounds:
        """Take the next sample."""
        if len(self.samples) <= self.horizon:
            self.samples.append(sample)
            self.answer = self.evaluate(self.samples)
        return self.answer


def is_nan(sample: list[float]) -> bool:
    """Whether any signal of the sample is NaN."""
    return any(map(math.isnan, sample))
