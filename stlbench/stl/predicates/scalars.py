"""Formulas without temporal operators to closures over one sample of plain floats, with sided values.

For one sample at a time plain Python is many times faster than NumPy. What counts here is the number of calls, so the
commonest shapes - a constant and a signal, a constant and anything - are one closure each.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import reduce
from operator import itemgetter
from typing import NoReturn, TypeAlias

import numpy as np

from stlbench.stl.errors import UndefinedError
from stlbench.stl.language.syntax import (
    And,
    Binary,
    Call,
    Expression,
    Formula,
    Implies,
    Negative,
    Not,
    Number,
    Or,
    Predicate,
    Signal,
)
from stlbench.stl.language.traversal import walk
from stlbench.stl.predicates.compiler import check_names, compile_sided, constant
from stlbench.stl.predicates.sided import zero_side

Sample: TypeAlias = Sequence[float]
Psi: TypeAlias = Callable[[Sample], float]
#: a part of an expression: a constant (float), a signal's column (int), or a closure
Part: TypeAlias = float | int | Psi

#: where Python raises and NumPy gives inf or NaN
_RAISING = {"sqrt", "sin", "cos", "exp", "/", "**"}


def compile_scalar(psi: Formula, names: tuple[str, ...], negated: bool = False) -> Psi:
    """The sided value of `psi` (of `!psi` if `negated`) at one sample, floats in the order of `names`.

    The closure raises UndefinedError where a predicate has no value; where Python has none (1/0) NumPy's counts.
    """
    arrays = compile_sided(Not(psi) if negated else psi, names)
    if not callable(arrays):
        constant = float(arrays)
        return lambda sample: constant
    undefined = _complaint(psi, names)
    fast = _Compiler(check_names(psi, names), undefined).formula(psi, negated)
    if not any(getattr(node, "name", getattr(node, "op", "")) in _RAISING for node in walk(psi)):
        return fast

    def run(sample: Sample) -> float:
        try:
            return fast(sample)
        except (ArithmeticError, ValueError):
            with np.errstate(all="ignore"):
                value = float(arrays(np.array(sample, dtype=float)))
            return value if value == value else undefined(sample)

    return run


def _complaint(psi: Formula, names: tuple[str, ...]) -> Callable[[Sample], NoReturn]:
    def undefined(sample: Sample) -> NoReturn:
        raise UndefinedError(f"{psi} has no value at {dict(zip(names, sample, strict=True))}")

    return undefined


class _Compiler:
    def __init__(self, index: dict[str, int], undefined: Callable[[Sample], NoReturn]) -> None:
        self.index, self.undefined = index, undefined

    def formula(self, node: Formula, negated: bool) -> Psi:
        match node:
            case Predicate():
                return self.predicate(node, negated)
            case Not(arg):
                return self.formula(arg, not negated)
            case And(args) | Or(args):
                pick = _least if isinstance(node, And) is not negated else _greatest
                return reduce(pick, [self.formula(arg, negated) for arg in args])
            case Implies(left, right):
                pick = _least if negated else _greatest
                return pick(self.formula(left, not negated), self.formula(right, negated))
            case _:
                top = -math.inf if negated else math.inf
                return lambda sample: top

    def predicate(self, node: Predicate, negated: bool) -> Psi:
        """The margin; at 0 its side. Negation swaps the operands, which negates floats exactly."""
        below = (node.op in ("<=", "<")) is not negated
        small, large = (node.left, node.right) if below else (node.right, node.left)
        side = -zero_side(node) if negated else zero_side(node)
        return self.margin(self.expression(large), self.expression(small), side)

    def margin(self, large: Part, small: Part, side: float) -> Psi:
        undefined = self.undefined

        def zero_or_nan(h: float, sample: Sample) -> float:
            return side if h == 0.0 else undefined(sample)

        if isinstance(large, float):
            return _from_constant(large, _reader(small), zero_or_nan)
        if isinstance(small, float):
            return _over_constant(_reader(large), small, zero_or_nan)
        return _over_constant(_reader(_difference(large, small)), 0.0, zero_or_nan)

    def expression(self, node: Expression) -> Part:
        value = constant(node)
        return self.varying(node) if value is None else value

    def varying(self, node: Expression) -> Part:
        """An expression with signals."""
        match node:
            case Signal(name):
                return self.index[name]
            case Negative(arg):
                return _difference(0.0, self.expression(arg))
            case Binary("-", left, right):
                return _difference(self.expression(left), self.expression(right))
            case Binary("**", left, Number(value)):
                return _power(_reader(self.expression(left)), int(value))
            case Binary(op, left, right):
                return _BINARY[op](_reader(self.expression(left)), _reader(self.expression(right)))
            case Call(name, args):
                return self.call(name, [self.expression(arg) for arg in args])
            case _:  # pragma: no cover - numbers are constant
                raise AssertionError(node)

    def call(self, name: str, args: list[Part]) -> Part:
        parts = [_reader(arg) for arg in args]
        match name:
            case "min" | "max":
                return reduce(_min if name == "min" else _max, parts)
            case "norm":
                return _norm(parts)
            case "norminf":
                return reduce(_max, map(_size, args))
            case "abs":
                return _size(args[0])
            case _:
                function, arg = getattr(math, name), parts[0]
                return lambda sample: function(arg(sample))


def _from_constant(large: float, small: Psi, zero_or_nan: Callable[[float, Sample], float]) -> Psi:
    def run(sample: Sample) -> float:
        h = large - small(sample)
        return h if h > 0.0 or h < 0.0 else zero_or_nan(h, sample)

    return run


def _over_constant(large: Psi, small: float, zero_or_nan: Callable[[float, Sample], float]) -> Psi:
    def run(sample: Sample) -> float:
        h = large(sample) - small
        return h if h > 0.0 or h < 0.0 else zero_or_nan(h, sample)

    return run


def _least(left: Psi, right: Psi) -> Psi:
    def run(sample: Sample) -> float:
        a, b = left(sample), right(sample)
        return a if a < b else b

    return run


def _greatest(left: Psi, right: Psi) -> Psi:
    def run(sample: Sample) -> float:
        a, b = left(sample), right(sample)
        return a if a > b else b

    return run


def _reader(part: Part) -> Psi:
    if isinstance(part, float):
        return lambda sample: part
    return itemgetter(part) if isinstance(part, int) else part


def _difference(left: Part, right: Part) -> Psi:
    if isinstance(left, float) and isinstance(right, int):
        return lambda sample: left - sample[right]
    if isinstance(left, int) and isinstance(right, float):
        return lambda sample: sample[left] - right
    if isinstance(left, int) and isinstance(right, int):
        return lambda sample: sample[left] - sample[right]
    f, g = _reader(left), _reader(right)
    return lambda sample: f(sample) - g(sample)


def _size(part: Part) -> Psi:
    if isinstance(part, int):
        return lambda sample: abs(sample[part])
    arg = _reader(part)
    return lambda sample: abs(arg(sample))


def _min(left: Psi, right: Psi) -> Psi:
    """NaN if either is, as NumPy's; a - b is NaN too where both are the same infinity, so it cannot be asked."""

    def run(sample: Sample) -> float:
        a, b = left(sample), right(sample)
        return a if a <= b else b if b < a else math.nan

    return run


def _max(left: Psi, right: Psi) -> Psi:
    def run(sample: Sample) -> float:
        a, b = left(sample), right(sample)
        return a if a >= b else b if b > a else math.nan

    return run


def _norm(parts: list[Psi]) -> Psi:
    if len(parts) == 2:
        first, second = parts

        def pair(sample: Sample) -> float:
            a, b = first(sample), second(sample)
            return math.sqrt(a * a + b * b)

        return pair

    def run(sample: Sample) -> float:
        total = 0.0
        for part in parts:
            value = part(sample)
            total += value * value
        return math.sqrt(total)

    return run


def _power(base: Psi, exponent: int) -> Psi:
    def run(sample: Sample) -> float:
        value: float = base(sample) ** exponent
        return value

    return run


_BINARY: dict[str, Callable[[Psi, Psi], Psi]] = {
    "+": lambda left, right: lambda sample: left(sample) + right(sample),
    "*": lambda left, right: lambda sample: left(sample) * right(sample),
    "/": lambda left, right: lambda sample: left(sample) / right(sample),
}
