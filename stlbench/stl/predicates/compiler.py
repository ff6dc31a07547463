"""Expressions and untimed formulas as functions: of arrays whose last axis is the signals, or of floats.

They run at every environment step, so the formula is turned into Python source once, which is compiled. NumPy is faster
for many samples, and plain floats are for one: one writer writes both, with a `dialect` for each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from stlbench.stl.errors import UndefinedError, shorten
from stlbench.stl.language.syntax import Expression, Formula, Not, Predicate
from stlbench.stl.language.traversal import require_pointwise, signals
from stlbench.stl.predicates.dialect import ARRAYS, FLOATS
from stlbench.stl.predicates.expression_source import ExpressionWriter
from stlbench.stl.predicates.formula_source import FormulaWriter, Reading
from stlbench.stl.predicates.inputs import check_names
from stlbench.stl.predicates.source import functions, indented

#: a function of samples (..., k)
OfSamples: TypeAlias = Callable[[Any], Any]
#: what a formula compiles to: a constant, or a function of samples
Compiled: TypeAlias = OfSamples | float | bool
Sample: TypeAlias = Sequence[float]
#: a function of one sample of floats
OfSample: TypeAlias = Callable[[Sample], float]


class Written(NamedTuple):
    """A value as source.

    Attributes:
        lines, value: statements, and the text of the value after them.
        signed: whether it never is 0 or NaN; otherwise that remains to be asked.
        columns: of the signals that are read.
    """

    lines: tuple[str, ...]
    value: str
    signed: bool
    columns: tuple[int, ...]


def compile_margin(psi: Formula, names: tuple[str, ...]) -> Compiled:
    """The robustness of `psi` as a constant or a function of samples (..., k)."""
    return _of_arrays(psi, names, Reading.MARGIN)


def compile_signed(psi: Formula, names: tuple[str, ...]) -> Compiled:
    """The robustness of `psi` likewise, but never 0: see `signed_margin`."""
    return _of_arrays(psi, names, Reading.SIGNED)


def compile_holds(psi: Formula, names: tuple[str, ...]) -> Compiled:
    """The verdict of `psi` likewise; a margin that is NaN counts as false."""
    return _of_arrays(psi, names, Reading.HOLDS)


def compile_expression(node: Expression, names: tuple[str, ...]) -> Compiled:
    """The value of an expression likewise."""
    writer = ExpressionWriter(check_names(node, names), ARRAYS)
    part = writer.expression(node, 0)
    return _predicate(writer.returning(part), ARRAYS.namespace) if part.value is None else part.value


@lru_cache(maxsize=256)
def compile_sample(psi: Formula, names: tuple[str, ...], negated: bool = False) -> OfSample:
    """The signed value of `psi` (of `!psi` if `negated`) at one sample, floats in the order of `names`.

    The function raises UndefinedError where a predicate has no value; where Python alone has none, as for exp(1000),
    NumPy's counts.
    """
    body = FormulaWriter(_columns(psi, names), FLOATS, Reading.SIGNED).statements(psi, negated)
    if not isinstance(body, list):
        return lambda sample: body
    tried = ["try:", *indented(body), "except (ArithmeticError, ValueError): return in_arrays(sample)"]
    return _predicate(tried, {**FLOATS.namespace, "in_arrays": _in_arrays(psi, names, negated)})


def write_sample(psi: Formula, names: tuple[str, ...], negated: bool = False) -> Written:
    """The same value as source, where x0, x1, ... are the floats of the sample; for `FLOATS.namespace`.

    It raises ArithmeticError or ValueError where only `compile_sample` knows the value, or that there is none. Of one
    predicate it is the margin, which may be 0 or NaN.
    """
    alone = isinstance(psi.arg if isinstance(psi, Not) else psi, Predicate) and bool(signals(psi))
    writer = FormulaWriter(_columns(psi, names), FLOATS, Reading.MARGIN if alone else Reading.SIGNED)
    value = writer.formula(psi, negated, 0)
    return Written(tuple(writer.lines), value.text, not alone, tuple(writer.used))


def _in_arrays(psi: Formula, names: tuple[str, ...], negated: bool) -> OfSample:
    """The same by way of arrays, which have infinity or NaN where Python raises."""

    def run(sample: Sample) -> float:
        with np.errstate(all="ignore"):
            value = float(_of_arrays(psi, names, Reading.SIGNED, negated)(np.array(sample, dtype=float)))  # type: ignore[operator]
        if value != value:
            raise UndefinedError(f"{shorten(str(psi))} has no value") from None
        return value

    return run


@lru_cache(maxsize=512)
def _of_arrays(psi: Formula, names: tuple[str, ...], reading: Reading, negated: bool = False) -> Compiled:
    body = FormulaWriter(_columns(psi, names), ARRAYS, reading).statements(psi, negated)
    if not isinstance(body, list):
        return body
    return _predicate(body, ARRAYS.namespace)


def _predicate(body: Sequence[str], namespace: Mapping[str, Any]) -> Callable[[Any], Any]:
    return functions(["def predicate(sample):", *indented(body)], namespace)["predicate"]


def _columns(psi: Formula, names: tuple[str, ...]) -> dict[str, int]:
    require_pointwise(psi)
    return check_names(psi, names)
