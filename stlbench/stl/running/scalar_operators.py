"""Operators of the online monitor for one trace, as source: see `operator_source`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import count
from typing import TypeAlias

import numpy as np

from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates.compiler import Sample
from stlbench.stl.predicates.inputs import check_names
from stlbench.stl.predicates.source import block
from stlbench.stl.running.operator_source import Operator, Piece, constant, greatest_of, least_of, value_of
from stlbench.stl.running.operator_tree import Kit, Pointwise
from stlbench.stl.running.unfolding import Found, Kept, Recent, Unfolding

Bounds: TypeAlias = tuple[float, float]


class Lowest(Operator):
    """G[a,b] psi: one running minimum. `unknown` bounds psi at a sample that has not come yet."""

    def __init__(self, number: int, psi: Pointwise, interval: tuple[int, int], unknown: Bounds, flipped: bool) -> None:
        super().__init__(number, *interval, flipped)
        self.psi, self.unknown = psi, unknown

    def begin(self) -> list[str]:
        """No sample is known."""
        return [f"m.least{self.number} = inf", *self.publish(*map(constant, self.unknown))]

    def cuts(self) -> set[int]:
        """At the last step the value is certain."""
        return {self.start, self.stop, self.stop + 1}

    def piece(self, first: int, last: int) -> Piece:
        """Keep the least."""
        v, least = self.v, f"m.least{self.number}"
        columns, read, sign = self.reading(v, self.psi)
        if first == self.stop:
            take = [f"if {v} > {least}: {v} = {least}", *self.publish(v, v)]
            return Piece(first, last, columns, read, "", sign, take)
        lower, upper = (least_of(v, end) for end in self.unknown)
        take = block(f"if {v} < {least}", [f"{least} = {v}", *self.publish(lower, upper)])
        return Piece(first, last, columns, read, f"{v} >= {least}", sign, take)


class Nested(Operator):
    """F[a,c] G[d,e] psi: the best minimum of a window, in constant amortised work.

    Only a run of samples above the best so far can be better. `queue` has those of the run that can still be a
    window's minimum, values and steps, both rising. The first window in the run is complete at step `due`; its minimum
    is the first of the queue, is better than the best, and ends the run: the next one begins after it. An incomplete
    window can only lose what its seen part already lost, and the seen parts shrink as t grows, so of those the last
    window, t = c, decides alone (`open`).
    """

    def __init__(
        self,
        number: int,
        psi: Pointwise,
        outer: tuple[int, int],
        inner: tuple[int, int],
        unknown: Bounds,
        flipped: bool,
    ) -> None:
        (a, c), (d, e) = outer, inner
        super().__init__(number, a + d, c + e, flipped)
        self.psi, self.unknown = psi, unknown
        self.last, self.width = c + d, e - d

    def begin(self) -> list[str]:
        """No window is complete."""
        n = self.number
        known = [f"m.best{n} = -inf", f"m.open{n} = inf", f"m.queue{n} = deque()", f"m.due{n} = 0"]
        return [*known, *self.publish(*map(constant, self.unknown))]

    def cuts(self) -> set[int]:
        """From step `last` on the samples are those of the last window."""
        return {self.start, self.last, self.stop, self.stop + 1}

    def piece(self, first: int, last: int) -> Piece:
        """Count the window that is complete, and from `last` on the last one."""
        n, v, best = self.number, self.v, f"m.best{self.number}"
        columns, read, sign = self.reading(v, self.psi)
        if first == self.stop:
            return Piece(first, last, columns, read, "", sign, [*self._slide([]), *self.publish(best, best)])
        quiet, closing, ahead = f"{v} <= {best} and not m.queue{n}", [], "inf"
        if first >= self.last:
            ahead = f"m.open{n}"
            quiet = f"{quiet} and {v} >= {ahead}"
        bounds = self.publish(*(greatest_of(best, least_of(ahead, end)) for end in self.unknown))
        if first >= self.last:
            closing = block(f"if {v} < {ahead}", [f"{ahead} = {v}", *bounds])
        return Piece(first, last, columns, read, quiet, sign, [*closing, *self._slide(bounds)])

    def _slide(self, bounds: list[str]) -> list[str]:
        n, v = self.number, self.v
        complete = [f"m.best{n}, first = queue.popleft()", f"m.due{n} = first + {self.width + 1}", *bounds]
        run = [
            *block("if queue", block(f"while queue and queue[-1][0] >= {v}", ["queue.pop()"])),
            *block("else", [f"m.due{n} = now + {self.width}"]),
            f"queue.append(({v}, now))",
            *block(f"if now == m.due{n}", complete),
        ]
        anew = "elif queue: queue.clear()"
        return [f"queue = m.queue{n}", *block(f"if {v} > m.best{n}", run), anew]


class Until(Operator):
    """left U[a,b] right: the minimum of left so far (`guard`) and the best of right within it."""

    def __init__(
        self,
        number: int,
        psis: tuple[Pointwise, Pointwise],
        interval: tuple[int, int],
        unknowns: tuple[Bounds, Bounds],
        flipped: bool,
    ) -> None:
        super().__init__(number, 0, interval[1], flipped)
        self.left, self.right = psis
        self.a = interval[0]
        self.lows, self.highs = zip(*unknowns, strict=True)  # of left and of right

    def begin(self) -> list[str]:
        """Nothing is known."""
        n = self.number
        return [f"m.best{n} = -inf", f"m.guard{n} = inf", *self.publish("-inf", "inf")]

    def cuts(self) -> set[int]:
        """Left is read before the last step, right from a on; at 0 and a - 1 the bounds change of themselves."""
        return {0, 1, self.a - 1, self.a, self.stop, self.stop + 1}

    def piece(self, first: int, last: int) -> Piece:
        """Count left and right."""
        v, w, best, guard = self.v, self.w, f"m.best{self.number}", f"m.guard{self.number}"
        before, within = first < self.stop, first >= self.a
        left, of_left, sign_left = self.reading(v, self.left) if before else (set(), [], [])
        right, of_right, sign_right = self.reading(w, self.right) if within else (set(), [], [])
        quiet = [f"{v} >= {guard}"] * before + [f"({best} >= {guard} or {w} <= {best}) and {w} == {w}"] * within
        better = [f"{best} = {w} if {w} < {guard} else {guard}"]
        take = block(f"if {w} > {best} and {guard} > {best}", better) if within else []
        take += [f"if {v} < {guard}: {guard} = {v}"] if before else []
        take += self.publish(*(self._end(first, *ends) for ends in (self.lows, self.highs)))
        by_itself = first in (0, self.a - 1, self.stop)
        told = "" if by_itself else " and ".join(quiet)
        return Piece(first, last, left | right, [*of_left, *of_right], told, [*sign_left, *sign_right], take)

    def _end(self, now: int, left: float, right: float) -> str:
        """With the values that left and right take from now on: the next t' is the best of those ahead."""
        best = f"m.best{self.number}"
        if now == self.stop:
            return best
        ahead = right if now >= self.a - 1 or right < left else left
        return greatest_of(best, least_of(f"m.guard{self.number}", ahead))


class Replayed(Operator):
    """Any other formula: keeps the samples that what is not decided may still read, and evaluates it at each step."""

    def __init__(self, number: int, formula: Formula, names: tuple[str, ...], negated: bool) -> None:
        self.until = Unfolding(formula, names)
        super().__init__(number, 0, self.until.last, self.until.flipped is not negated)
        self.read = set(check_names(formula, names).values())
        self.namespace |= {f"begin{number}": self._begin, f"read{number}": self._read, f"take{number}": self._take}

    def begin(self) -> list[str]:
        """There are no samples."""
        return [f"m.samples{self.number}, m.kept{self.number} = begin{self.number}()", *self.publish("-inf", "inf")]

    def cuts(self) -> set[int]:
        """The same at all steps."""
        return {0, self.stop + 1}

    def piece(self, first: int, last: int) -> Piece:
        """Evaluate with one more sample, and keep it."""
        n, v = self.number, self.v
        read = f"{v} = read{n}(m.samples{n}, m.kept{n}, sample, now)"
        kept = [f"m.kept{n} = {v}.kept", f"take{n}(m.samples{n}, now)"]
        return Piece(
            first,
            last,
            self.read,
            [read],
            "",
            [],
            [*kept, *self.publish(f"{v}.lower.item()", f"{v}.upper.item()")],
        )

    def _begin(self) -> tuple[Recent, Kept]:
        return Recent(1, len(self.until.names)), self.until.begin(1)

    def _read(self, samples: Recent, kept: Kept, sample: Sample, now: int) -> Found:
        newest = np.array([[value if i in self.read else 0.0 for i, value in enumerate(sample)]])
        return self.until.read(samples.with_newest(newest, min(now + 1, self.until.window)), now, kept)

    def _take(self, samples: Recent, now: int) -> None:
        samples.take(min(now + 1, self.until.window))


def one() -> Kit[Operator]:
    """The operators for one trace, numbered from 0."""
    numbers: Iterator[int] = count()

    def numbered(operator: Callable[..., Operator]) -> Callable[..., Operator]:
        return lambda *arguments: operator(next(numbers), *arguments)

    return Kit(min, max, value_of, *map(numbered, (Lowest, Nested, Until, Replayed)))
