"""What an operator of the online monitor for one trace is made of: the source of what is done with a sample.

`monitor_source` puts what all operators of a formula do at a step into one function, which is many times faster for one
sample than NumPy, and a few times faster than a call for each operator. Constants in the source are numbers of steps
and reprs of floats.

Operator number n keeps what it knows in attributes of the state `m` that end in n; among them are `lower` and `upper`,
its bounds. Its variables v and w are the values of its operands at the sample.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from stlbench.stl.errors import UndefinedError
from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates.compiler import OfSample, Sample, Written, compile_sample, write_sample
from stlbench.stl.predicates.source import block
from stlbench.stl.recorded.evaluator import cause
from stlbench.stl.running.operator_tree import Leaf, Pointwise

WRITTEN_OUT = 12
"""Statements of a predicate that are written into the function; a longer one is a function of its own."""


class Piece(NamedTuple):
    """What an operator does at the steps `first`..`last`: statements.

    Attributes:
        columns: of the signals that are read.
        read: gives v and w their values, and changes nothing else.
        quiet: an expression, false where v or w is NaN and wherever `take` would change anything; or nothing.
        sign: gives v and w the sign of the verdict where they are 0. `read` and `sign` raise UndefinedError.
        take: takes the values into the state; `changed` says whether the bounds may be others.
    """

    first: int
    last: int
    columns: set[int]
    read: list[str]
    quiet: str
    sign: list[str]
    take: list[str]


class Operator(Leaf):
    """A leaf as source."""

    def __init__(self, number: int, start: int, stop: int, flipped: bool) -> None:
        super().__init__(start, stop, flipped)
        self.number = number
        self.lower, self.upper = f"m.lower{number}", f"m.upper{number}"
        self.v, self.w = f"v{number}", f"w{number}"
        self.namespace: dict[str, Any] = {}
        """What the source calls beside the functions of predicates."""

    def begin(self) -> list[str]:
        """What is known before the first sample."""
        raise NotImplementedError

    def cuts(self) -> set[int]:
        """Steps at which other statements are called for than at the step before, `start` and `stop` + 1 among them."""
        raise NotImplementedError

    def piece(self, first: int, last: int) -> Piece:
        """The statements for the steps from one cut to before the next."""
        raise NotImplementedError

    def pieces(self) -> list[Piece]:
        """All of them, in order."""
        steps = sorted(step for step in self.cuts() if self.start <= step <= self.stop + 1)
        return [self.piece(first, after - 1) for first, after in pairwise(steps)]

    def publish(self, lower: str, upper: str) -> list[str]:
        """Set the bounds."""
        if self.flipped:
            lower, upper = f"-({upper})", f"-({lower})"
        return [f"{self.lower} = {lower}", f"{self.upper} = {upper}", "changed = True"]

    def reading(self, name: str, asked: Pointwise) -> tuple[set[int], list[str], list[str]]:
        """`columns`, `read` and `sign` of a variable that has the value of a formula without temporal operators."""
        value: Value = asked.value
        self.namespace[f"whole_{name}"] = value.whole
        columns, whole = set(value.written.columns), f"{name} = whole_{name}(sample, now)"
        if len(value.written.lines) > WRITTEN_OUT:
            return columns, [whole], []
        tried = block("try", [*value.written.lines, f"{name} = {value.written.value}"])
        sign = [] if value.written.signed else [f"if not ({name} > 0.0 or {name} < 0.0): {whole}"]
        return columns, [*tried, f"except (ArithmeticError, ValueError): {whole}"], sign


class Value(NamedTuple):
    """A formula without temporal operators at a sample (x0, x1, ...)."""

    written: Written
    whole: Callable[[Sample, int], float]
    """Of a sample and its step, where what is written does not do; raises UndefinedError with the cause where there is
    no value."""


def value_of(psi: Formula, names: tuple[str, ...], negated: bool) -> Value:
    """Psi, or its negation."""

    @cache
    def compiled() -> OfSample:
        return compile_sample(psi, names, negated)

    def whole(sample: Sample, now: int) -> float:
        try:
            return compiled()(sample)
        except UndefinedError:
            raise UndefinedError(cause(psi, names, np.array(sample)), now) from None

    return Value(write_sample(psi, names, negated), whole)


def constant(value: float) -> str:
    """A number as an operand."""
    return repr(float(value)) if value >= 0 else f"({float(value)!r})"


def least_of(text: str, value: float) -> str:
    """The lesser of an expression, which is a name, and a constant."""
    if math.isinf(value):
        return text if value > 0 else "-inf"
    return f"({text} if {text} < {value!r} else {value!r})"


def greatest_of(name: str, other: str) -> str:
    """The greater of a name and an expression."""
    if other in ("inf", "-inf", "(-inf)"):
        return "inf" if other == "inf" else name
    return f"({name} if {name} > {other} else {other})"
