"""Formulas without temporal operators to closures over arrays of samples, whose last axis is the signals.

The closures run at every environment step, so the tree is walked once here and never again: constants are folded, a
signal is one C-level `itemgetter`, and each operator is one NumPy call.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from functools import reduce
from operator import itemgetter
from typing import Any, TypeAlias

import numpy as np

from stlbench.stl.errors import UndefinedError, UnknownSignalError
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
    TrueFormula,
)
from stlbench.stl.language.traversal import is_temporal, signals, walk
from stlbench.stl.predicates.sided import zero_side

Closure: TypeAlias = Callable[[Any], Any]
#: a compiled operand: a constant, or a closure over the sample
Operand: TypeAlias = Closure | float | bool

_ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
}


_FUNCTIONS: dict[str, Closure] = {"abs": abs, "sqrt": np.sqrt, "sin": np.sin, "cos": np.cos, "exp": np.exp}


def compile_margin(psi: Formula, names: tuple[str, ...]) -> Operand:
    """The robustness of `psi` as a constant or a closure over samples (..., k)."""
    compiler = _Compiler(_index(psi, names))
    return compiler.formula(psi, compiler.margin, operator.neg, math.inf)


def compile_sided(psi: Formula, names: tuple[str, ...]) -> Operand:
    """The robustness of `psi` likewise, but never 0: see `sided`."""
    compiler = _Compiler(_index(psi, names))

    def predicate(node: Predicate) -> Operand:
        side = zero_side(node)
        h = compiler.margin(node)
        return _apply(lambda value: np.where(value == 0.0, side, value), h) if callable(h) else h or side

    return compiler.formula(psi, predicate, operator.neg, math.inf)


def compile_holds(psi: Formula, names: tuple[str, ...], checked: bool = False) -> Operand:
    """The verdict of `psi` likewise; `checked` raises UndefinedError on NaN margins."""
    compiler = _Compiler(_index(psi, names))

    def predicate(node: Predicate) -> Operand:
        test = operator.ge if node.op in ("<=", ">=") else operator.gt
        h = compiler.margin(node)
        if not callable(h):
            return bool(test(h, 0.0))
        if checked:
            return lambda x: test(_defined(h(x)), 0.0)
        return lambda x: test(h(x), 0.0)

    return compiler.formula(psi, predicate, np.logical_not, True)


def constant(node: Expression) -> float | None:
    """The value of an expression without signals, None for one with signals."""
    if any(isinstance(part, Signal) for part in walk(node)):
        return None
    return float(_Compiler({}).expression(node))  # type: ignore[arg-type]  # nothing in it is a closure


class _Compiler:
    def __init__(self, index: dict[str, int]) -> None:
        self.index = index

    def formula(
        self, psi: Formula, predicate: Callable[[Predicate], Operand], negate: Closure, true: float | bool
    ) -> Operand:
        def compile_(node: Formula) -> Operand:
            match node:
                case TrueFormula():
                    return true
                case Predicate():
                    return predicate(node)
                case Not(arg):
                    return _apply(negate, compile_(arg))
                case And(args):
                    return reduce(lambda x, y: _combine(np.minimum, x, y), map(compile_, args))
                case Or(args):
                    return reduce(lambda x, y: _combine(np.maximum, x, y), map(compile_, args))
                case Implies(left, right):
                    return _combine(np.maximum, _apply(negate, compile_(left)), compile_(right))
                case _:
                    raise ValueError(f"expected a formula without temporal operators, got {node}")

        return compile_(psi)

    def margin(self, node: Predicate) -> Operand:
        small, large = (node.left, node.right) if node.op in ("<=", "<") else (node.right, node.left)
        return _combine(operator.sub, self.expression(large), self.expression(small))

    def expression(self, node: Expression) -> Operand:
        match node:
            case Number(value):
                return value
            case Signal(name):
                return itemgetter((Ellipsis, self.index[name]))
            case Negative(arg):
                return _apply(operator.neg, self.expression(arg))
            case Binary("**", left, Number(value)):
                exponent = int(value)
                return _apply(lambda base: base**exponent, self.expression(left))
            case Binary(op, left, right):
                return _combine(_ARITHMETIC[op], self.expression(left), self.expression(right))
            case Call(name, args):
                return self.call(name, [self.expression(arg) for arg in args])

    def call(self, name: str, args: list[Operand]) -> Operand:
        match name:
            case "min" | "max":
                pick = np.minimum if name == "min" else np.maximum
                return reduce(lambda x, y: _combine(pick, x, y), args)
            case "norm":
                squares = [_apply(_square, arg) for arg in args]
                total = reduce(lambda x, y: _combine(operator.add, x, y), squares)
                return _apply(_FUNCTIONS["sqrt"], total)
            case "norminf":
                return reduce(lambda x, y: _combine(np.maximum, x, y), [_apply(abs, arg) for arg in args])
            case _:
                return _apply(_FUNCTIONS[name], args[0])


def _square(value: Any) -> Any:
    return value * value


def _apply(function: Closure, arg: Operand) -> Operand:
    if callable(arg):
        return lambda x: function(arg(x))
    return _fold(function, arg)


def _combine(function: Callable[[Any, Any], Any], left: Operand, right: Operand) -> Operand:
    if callable(left) and callable(right):
        return lambda x: function(left(x), right(x))
    if callable(left):
        return lambda x: function(left(x), right)
    if callable(right):
        return lambda x: function(left, right(x))
    return _fold(function, left, right)


def _fold(function: Callable[..., Any], *constants: float | bool) -> float | bool:
    """The value of a constant subexpression, once, at compile time."""
    with np.errstate(all="ignore"):
        try:
            value: float | bool = function(*constants)
        except (ArithmeticError, ValueError):
            value = math.nan
    if math.isnan(value):
        raise UndefinedError(f"a constant of the formula has no value ({', '.join(map(str, constants))})")
    return value


def _defined(h: Any) -> Any:
    if np.isnan(h).any():
        raise UndefinedError("a predicate has no value")
    return h


def _index(psi: Formula, names: tuple[str, ...]) -> dict[str, int]:
    if is_temporal(psi):
        raise ValueError(f"expected a formula without temporal operators, got {psi}")
    return check_names(psi, names)


def check_names(formula: Formula, names: tuple[str, ...], where: str = "trace") -> dict[str, int]:
    """Column of each name.

    Raises:
        UnknownSignalError: `formula` uses another signal.
        ValueError: a name occurs twice.
    """
    index = {name: column for column, name in enumerate(names)}
    if len(index) < len(names):
        raise ValueError(f"signal names must differ, got {', '.join(names)}")
    for name in signals(formula):
        if name not in index:
            raise UnknownSignalError(name, names, where)
    return index
