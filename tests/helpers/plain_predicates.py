"""Formulas without temporal operators evaluated by walking the tree, in plain floats: the definition, slow and plain.

NaN stands for "has no value". Shares nothing with the compiler or the table of functions.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from stlbench import stl

#: stands for a margin of 0, with the sign of the verdict
SMALLEST = 2.0**-1022


def value(node: stl.Expression, sample: Mapping[str, float]) -> float:
    """The value at one sample."""
    match node:
        case stl.Number(number):
            return number
        case stl.Signal(name):
            return sample[name]
        case stl.Negative(arg):
            return -value(arg, sample)
        case stl.Binary(op, left, right):
            return arithmetic(op, value(left, sample), value(right, sample))
        case stl.Call(name, args):
            return call(name, [value(arg, sample) for arg in args])


def arithmetic(op: str, left: float, right: float) -> float:
    match op:
        case "+":
            return left + right
        case "-":
            return left - right
        case "*":
            return left * right
        case "/":
            return left / right if right != 0 else math.nan
        case _:
            return left * left if right == 2 else left**right


def call(name: str, args: list[float]) -> float:
    if any(map(math.isnan, args)):
        return math.nan
    match name:
        case "min":
            return min(args)
        case "max":
            return max(args)
        case "norminf":
            return max(map(abs, args))
        case "norm":
            total = args[0] * args[0]
            for arg in args[1:]:
                total = total + arg * arg
            return math.sqrt(total)
        case "abs":
            return abs(args[0])
        case "sqrt":
            return math.sqrt(args[0]) if args[0] >= 0 else math.nan
        case "log":
            return math.log(args[0]) if args[0] > 0 else math.nan
        case _:
            raise NotImplementedError(name)


def margin(psi: stl.Formula, sample: Mapping[str, float]) -> float:
    """The robustness at one sample."""
    return _walked(psi, lambda node: _difference(node, sample), math.inf)


def signed(psi: stl.Formula, sample: Mapping[str, float]) -> float:
    """The robustness, where a predicate's margin of 0 has the sign of its verdict."""

    def predicate(node: stl.Predicate) -> float:
        h = _difference(node, sample)
        if h == 0:
            return SMALLEST if node.op in ("<=", ">=") else -SMALLEST
        return h

    return _walked(psi, predicate, math.inf)


def satisfied(psi: stl.Formula, sample: Mapping[str, float]) -> bool:
    """The verdict; a predicate without a value is false."""

    def predicate(node: stl.Predicate) -> float:
        h = _difference(node, sample)
        return 1.0 if h > 0 or (h == 0 and node.op in ("<=", ">=")) else -1.0

    return _walked(psi, predicate, 1.0) > 0


def _difference(node: stl.Predicate, sample: Mapping[str, float]) -> float:
    left, right = value(node.left, sample), value(node.right, sample)
    return right - left if node.op in ("<=", "<") else left - right


def _walked(psi: stl.Formula, predicate: Callable[[stl.Predicate], float], true: float) -> float:
    """NaN as soon as one predicate is."""
    match psi:
        case stl.Predicate():
            return predicate(psi)
        case stl.TrueFormula():
            return true
        case stl.Not(arg):
            return -_walked(arg, predicate, true)
        case stl.And(args):
            return call("min", [_walked(arg, predicate, true) for arg in args])
        case stl.Or(args):
            return call("max", [_walked(arg, predicate, true) for arg in args])
        case stl.Implies(left, right):
            return call("max", [-_walked(left, predicate, true), _walked(right, predicate, true)])
        case _:
            raise ValueError(psi)
