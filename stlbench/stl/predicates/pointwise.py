"""Expressions, and formulas without temporal operators, per sample: cheap enough for every step of an environment."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.language.syntax import Expression, Formula
from stlbench.stl.language.traversal import require_formula
from stlbench.stl.predicates.compiler import Compiled, OfSamples, compile_expression, compile_holds, compile_margin
from stlbench.stl.predicates.inputs import as_array, as_names

Samples: TypeAlias = NDArray[np.float64]


def margin(psi: Formula, names: Sequence[str]) -> Callable[[Samples], Samples]:
    """Compile the robustness of `psi` per sample.

    Args:
        psi: a formula without temporal operators.
        names: the signals, in the order of the samples' last axis.

    Returns:
        A pure function: samples (..., k) of floats, in the signals' units -> rho (...,), > 0 where psi holds with that
        margin, < 0 where it fails; for one sample (k,) a NumPy scalar. What has no value is NaN, what overflows inf.
        Raises TypeError for a masked array.

    Raises:
        TypeError: psi is text.
        UnknownSignalError: psi uses a signal that is not in `names`.
        UndefinedError: a constant of psi has no value, as in 1 / 0.
        ValueError: psi has temporal operators, or a name occurs twice.
    """
    require_formula(psi)
    return _margin(psi, as_names(names))


def holds(psi: Formula, names: Sequence[str]) -> Callable[[Samples], NDArray[np.bool_]]:
    """Compile the Boolean verdict of `psi` per sample: `<=`, `>=` hold iff the margin is >= 0, `<`, `>` iff it is > 0.

    Arguments, errors and shapes as `margin`; the function returns bool (...,). NaN margins count as false.
    """
    require_formula(psi)
    return _holds(psi, as_names(names))


def values(expressions: Sequence[Expression], names: Sequence[str]) -> Callable[[Samples], Samples]:
    """Compile arithmetic per sample: k expressions (see `parse_expression`) over n names.

    Returns:
        A pure function: samples (..., n) of floats -> (..., k), a column for each expression. What has no value is NaN,
        what overflows inf.

    Raises:
        UnknownSignalError: an expression uses a name that is not in `names`.
        UndefinedError: a constant has no value, as in 1 / 0.
        ValueError: a name occurs twice.
    """
    columns = [_filled(compile_expression(node, as_names(names)), float) for node in expressions]

    return lambda samples: np.stack([column(samples) for column in columns], axis=-1)


@lru_cache(maxsize=256)
def _margin(psi: Formula, names: tuple[str, ...]) -> OfSamples:
    return _filled(compile_margin(psi, names), float)


@lru_cache(maxsize=256)
def _holds(psi: Formula, names: tuple[str, ...]) -> OfSamples:
    return _filled(compile_holds(psi, names), bool)


def _filled(compiled: Compiled, dtype: type) -> OfSamples:
    """A constant formula still answers with the batch's shape. Nothing warns of NaN or infinity."""
    if callable(compiled):
        return np.errstate(all="ignore")(compiled)
    return lambda samples: np.full(as_array(samples).shape[:-1], compiled, dtype=dtype)
