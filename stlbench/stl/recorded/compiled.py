"""Formulas with temporal operators compiled once, for the short traces that an environment asks about at every step.

What `pointwise` is for one sample: without the checks of `robustness_trace`, which cost more than a short trace does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.language.horizon import horizon
from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates.compiler import check_names, compile_holds
from stlbench.stl.recorded.evaluator import BOOLEAN, ROBUST, Algebra, Recording, plan
from stlbench.stl.recorded.windows import Values

Samples: TypeAlias = NDArray[np.float64]
UNCHECKED = replace(BOOLEAN, compile=compile_holds)


def margin_trace(formula: Formula, names: Sequence[str]) -> Callable[[Samples], Samples]:
    """Compile the robustness of `formula` at every step at which it can be told.

    Args:
        formula: any formula; intervals in steps.
        names: the signals, in the order of the samples' last axis.

    Returns:
        A pure function: traces (n, T+1, k) of floats, T >= horizon, in the signals' units -> rho (n, T+1-horizon), as
        `robustness_trace` says. Undefined arithmetic gives inf or NaN.

    Raises:
        UnknownSignalError: the formula uses a signal that is not in `names`.
        ValueError: a name occurs twice.
    """
    return _compiled(formula, tuple(names), ROBUST)


def holds_trace(formula: Formula, names: Sequence[str]) -> Callable[[Samples], NDArray[np.bool_]]:
    """Compile the Boolean verdict of `formula` likewise, bool (n, T+1-horizon). NaN margins count as false."""
    return _compiled(formula, tuple(names), UNCHECKED)


def _compiled(formula: Formula, names: tuple[str, ...], algebra: Algebra) -> Callable[[Samples], Values]:
    check_names(formula, names)
    values, ahead = plan(formula, names, algebra), horizon(formula)

    def run(samples: Samples) -> Values:
        last = samples.shape[1] - 1
        return values(Recording(samples, "strict", last), 0, last - ahead, True)

    return run
