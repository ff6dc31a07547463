"""Operators of the online monitor for one trace: the source of what each does with a sample.

`monitor` puts what all operators of a formula do at a step into one function. For one sample that is many times faster
than NumPy, and a few times faster than a call for each operator. Constants in the source are numbers of steps and reprs
of floats.

Operator number n keeps its state in attributes of `m` that end in n; among them are `lower` and `upper`, its bounds.
Its variables v and w are the values of its operands at the sample.
"""

import math
from collections.abc import Callable
from functools import cache
from itertools import groupby, pairwise
from typing import Any, NamedTuple

import numpy as np

from stlbench.stl.errors import UndefinedError
from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates import OfSample, Sample, Written, compile_sample, write_sample
from stlbench.stl.predicates.writer import block
from stlbench.stl.recorded.evaluator import cause
from stlbench.stl.running.tree import Interval, Leaf, Pointwise

WRITTEN_OUT = 12  # statements of a predicate that are written into the function; a longer one is a function of its own


class Piece(NamedTuple):
    """The statements of an operator at the steps `first`..`last`. `read` and `sign` may raise UndefinedError."""

    first: int
    last: int
    columns: set[int]  # of the signals that are read
    read: list[str]  # gives v and w their values, and changes nothing else
    quiet: str  # an expression, false where v or w is NaN and wherever `take` would change anything; or nothing
    sign: list[str]  # gives v and w the sign of the verdict where they are 0
    take: list[str]  # takes the values into the state; sets `changed` where the bounds may differ


class Operator(Leaf):
    """A leaf as source; `namespace` has its own functions that the source calls."""

    def __init__(self, number: int, start: int, stop: int, flipped: bool) -> None:
        super().__init__(start, stop, flipped)
        self.number = number
        self.lower, self.upper = f"m.lower{number}", f"m.upper{number}"
        self.v, self.w = f"v{number}", f"w{number}"
        self.namespace: dict[str, Any] = {}

    def begin(self) -> list[str]:
        raise NotImplementedError

    def cuts(self) -> set[int]:
        """Steps at which the statements change, without `start` and `stop` + 1."""
        return set()

    def piece(self, first: int, last: int) -> Piece:
        raise NotImplementedError

    def pieces(self) -> list[Piece]:
        cuts = {self.start, self.stop + 1, *self.cuts()}
        steps = sorted(step for step in cuts if self.start <= step <= self.stop + 1)
        found = [self.piece(first, after - 1) for first, after in pairwise(steps)]
        alike = groupby(found, key=lambda piece: piece._replace(first=0, last=0))
        return [(some := list(same))[0]._replace(last=some[-1].last) for _, same in alike]

    def publish(self, lower: str, upper: str) -> list[str]:
        if self.flipped:
            lower, upper = f"-({upper})", f"-({lower})"
        return [f"{self.lower} = {lower}", f"{self.upper} = {upper}", "changed = True"]

    def reading(self, name: str, psi: Pointwise) -> tuple[set[int], list[str], list[str]]:
        """`columns`, `read` and `sign` of a variable that has the value of a formula without temporal operators."""
        value: Reading = psi.value
        self.namespace[f"whole_{name}"] = value.whole
        columns, whole = set(value.written.columns), f"{name} = whole_{name}(sample, now)"
        if len(value.written.lines) > WRITTEN_OUT:
            return columns, [whole], []
        tried = block("try", [*value.written.lines, f"{name} = {value.written.value}"])
        sign = [] if value.written.signed else [f"if not ({name} > 0.0 or {name} < 0.0): {whole}"]
        return columns, [*tried, f"except (ArithmeticError, ValueError): {whole}"], sign


class Reading(NamedTuple):
    """A formula without temporal operators at a sample (x0, x1, ...)."""

    written: Written
    whole: Callable[[Sample, int], float]  # of a sample and its step, for values that the source cannot work out


def value_of(psi: Formula, names: tuple[str, ...], negated: bool) -> Reading:
    @cache
    def compiled() -> OfSample:
        return compile_sample(psi, names, negated)

    def whole(sample: Sample, now: int) -> float:
        try:
            return compiled()(sample)
        except UndefinedError:
            raise UndefinedError(cause(psi, names, np.array(sample)), now) from None

    return Reading(write_sample(psi, names, negated), whole)


def _constant(value: float) -> str:
    return repr(float(value)) if value >= 0 else f"({float(value)!r})"


def _least_of(name: str, value: float) -> str:
    if math.isinf(value):
        return name if value > 0 else "-inf"
    return f"({name} if {name} < {value!r} else {value!r})"


def _greatest_of(name: str, other: str) -> str:
    if other in ("inf", "-inf", "(-inf)"):
        return "inf" if other == "inf" else name
    return f"({name} if {name} > {other} else {other})"


class Until(Operator):
    """left U[a,b] right: the least of left so far (`guard`) and the best of right within it. Without left: F."""

    def __init__(
        self, number: int, left: Pointwise | None, right: Pointwise, interval: Interval, flipped: bool
    ) -> None:
        self.a, stop = interval
        super().__init__(number, 0 if left else self.a, stop, flipped)
        self.left, self.right = left, right
        self.best, self.guard = f"m.best{number}", f"m.guard{number}"

    def begin(self) -> list[str]:
        if self.left:
            return [f"{self.best} = -inf", f"{self.guard} = inf", *self.publish("-inf", "inf")]
        return [f"{self.best} = -inf", *self.publish(*map(_constant, self.right.unknown))]

    def cuts(self) -> set[int]:
        """Left is read before the last step, right from a on; at 0 and a - 1 the bounds change of themselves."""
        return {1, self.a - 1, self.a, self.stop} if self.left else {self.stop}

    def piece(self, first: int, last: int) -> Piece:
        if self.left is None:
            return self._eventually(first, last)
        v, w, best, guard = self.v, self.w, self.best, self.guard
        before, within = first < self.stop, first >= self.a
        left, of_left, sign_left = self.reading(v, self.left) if before else (set(), [], [])
        right, of_right, sign_right = self.reading(w, self.right) if within else (set(), [], [])
        quiet = [f"{v} >= {guard}"] * before + [f"({best} >= {guard} or {w} <= {best}) and {w} == {w}"] * within
        better = [f"{best} = {w} if {w} < {guard} else {guard}"]
        take = block(f"if {w} > {best} and {guard} > {best}", better) if within else []
        take += [f"if {v} < {guard}: {guard} = {v}"] if before else []
        # from now on: the next step to count has right, from a on, or left
        ends = zip(self.left.unknown, self.right.unknown, strict=True)
        ahead = [right if first >= self.a - 1 or right < left else left for left, right in ends]
        bounds = [best if first == self.stop else _greatest_of(best, _least_of(guard, end)) for end in ahead]
        by_itself = first in (0, self.a - 1, self.stop)
        never = "" if by_itself else " and ".join(quiet)
        sign = [*sign_left, *sign_right]
        return Piece(first, last, left | right, [*of_left, *of_right], never, sign, [*take, *self.publish(*bounds)])

    def _eventually(self, first: int, last: int) -> Piece:
        w, best = self.w, self.best
        columns, read, sign = self.reading(w, self.right)
        better = f"if {w} > {best}"
        if first == self.stop:
            take = [f"{better}: {best} = {w}", *self.publish(best, best)]
            return Piece(first, last, columns, read, "", sign, take)
        bounds = (_greatest_of(w, _constant(end)) for end in self.right.unknown)
        take = block(better, [f"{best} = {w}", *self.publish(*bounds)])
        return Piece(first, last, columns, read, f"{w} <= {best}", sign, take)
