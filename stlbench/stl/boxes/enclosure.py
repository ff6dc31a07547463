"""Intervals that contain a margin, or an expression, on many boxes at once: the tighter of two forms, end by end.

Plain interval arithmetic takes each operation by itself. The mean-value form takes the whole: by the mean value theorem
(for Lipschitz functions, with Clarke's generalised gradient), on a box X with middle c, f(X) lies in
f(c) + sum_i df/dx_i(X) (X_i - c_i). Its error falls with the square of the box, where that of plain interval arithmetic
falls linearly; it is what proves x - x = 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import reduce
from typing import TypeAlias, TypeVar, cast

import numpy as np

from stlbench.arithmetic.derivatives import Derivatives, negated, of_difference
from stlbench.arithmetic.functions import OPERATIONS
from stlbench.arithmetic.intervals import Range, difference, negative, power, product, total
from stlbench.stl.language.expressions import Binary, Call, Negative, Number, Signal
from stlbench.stl.language.syntax import AnyNode, Connective, Not, Predicate, TrueFormula

T = TypeVar("T")
#: each signal's interval on each box: ends (m,)
Boxes: TypeAlias = dict[str, Range]
#: proven ranges of subexpressions whose own interval may be too wide (arguments of sqrt and divisors)
Proven: TypeAlias = dict[AnyNode, tuple[float, float]]


def enclosure(target: AnyNode, boxes: Boxes, proven: Proven) -> Range:
    rates = Enclosure(boxes, proven, with_derivatives=True)
    plain, centred = rates.range(target), mean_value_range(target, boxes, proven, rates)
    return np.fmax(plain[0], centred[0]), np.fmin(plain[1], centred[1])


def mean_value_range(target: AnyNode, boxes: Boxes, proven: Proven, rates: Enclosure | None = None) -> Range:
    """The mean-value form on each box, NaN where no derivative bounds it; `rates` are the derivatives on `boxes`."""
    rates = rates or Enclosure(boxes, proven, with_derivatives=True)
    middles = {name: low / 2 + high / 2 for name, (low, high) in boxes.items()}
    at = {name: (middle, middle) for name, middle in middles.items()}
    centre = Enclosure(at, proven).range(target)
    steps = [
        product(derivative, difference(boxes[name], at[name])) for name, derivative in rates.derivatives(target).items()
    ]
    return reduce(total, steps, centre)


class Enclosure:
    """Plain intervals of a formula's or an expression's parts on some boxes, and of their derivatives; each once."""

    def __init__(self, boxes: Boxes, proven: Proven, with_derivatives: bool = False) -> None:
        self.boxes, self.proven, self.with_derivatives = boxes, proven, with_derivatives
        self._known: dict[AnyNode, tuple[Range, Derivatives]] = {}

    def range(self, node: AnyNode) -> Range:
        return self._of(node)[0]

    def derivatives(self, node: AnyNode) -> Derivatives:
        return self._of(node)[1]

    def _of(self, node: AnyNode) -> tuple[Range, Derivatives]:
        known = self._known.get(node)
        if known is None:
            args = [self._of(arg) for arg in _operands(node)]
            ranges, inner = [arg[0] for arg in args], [arg[1] for arg in args]
            own = self._range(node, ranges)
            value = self._clipped(node, own)
            known = value, (self._derivatives(node, ranges, inner, value) if self.with_derivatives else {})
            self._known[node] = known
        return known

    def _clipped(self, node: AnyNode, range_: Range) -> Range:
        if node not in self.proven:
            return range_
        least, most = self.proven[node]
        return np.clip(range_[0], least, most), np.clip(range_[1], least, most)

    def _range(self, node: AnyNode, args: list[Range]) -> Range:
        match node:
            case TrueFormula():
                return np.array(math.inf), np.array(math.inf)
            case Number(value):
                return np.array(value), np.array(value)
            case Signal(name):
                return self.boxes[name]
            case Predicate():
                large, small = args
                return total(large, negative(small))
            case Not() | Negative():
                return negative(args[0])
            case Connective():
                return OPERATIONS["min" if node.least else "max"].interval(_signed(node, args, negative))
            case Binary("*", left, right) if left == right:
                return power(args[0], 2)
            case Call(name) | Binary(name):
                return OPERATIONS[name].interval(args)
            case _:
                raise ValueError(f"expected a formula without temporal operators, got {node}")

    def _derivatives(self, node: AnyNode, args: list[Range], inner: list[Derivatives], value: Range) -> Derivatives:
        match node:
            case Signal(name):
                one = np.ones_like(self.boxes[name][0])
                return {name: (one, one)}
            case Predicate():
                return of_difference(args, inner, value)
            case Not() | Negative():
                return negated(inner[0])
            case Connective():
                rule = OPERATIONS["min" if node.least else "max"].derivative
                return rule(_signed(node, args, negative), _signed(node, inner, negated), value)
            case Call(name) | Binary(name):
                return OPERATIONS[name].derivative(args, inner, value)
            case _:
                return {}


def _operands(node: AnyNode) -> tuple[AnyNode, ...]:
    """The operands; of a predicate the greater side and the smaller side."""
    match node:
        case Predicate(op, left, right):
            return (right, left) if op in ("<=", "<") else (left, right)
        case _:
            return cast(tuple[AnyNode, ...], node.operands)


def _signed(node: Connective, parts: list[T], opposite: Callable[[T], T]) -> list[T]:
    """What the operands have, or the opposite where the negation of an operand counts."""
    return [opposite(part) if sign else part for (_, sign), part in zip(node.signed, parts, strict=True)]
