"""Formulas with temporal operators compiled once, for the short traces that an environment asks about at every step.

What `pointwise` is for one sample: without the checks of `robustness_trace`, which cost more than a short trace does.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from stlbench.stl.language.syntax import Formula
from stlbench.stl.language.traversal import require_formula
from stlbench.stl.predicates.compiler import compile_margin, compile_signed
from stlbench.stl.predicates.inputs import as_names
from stlbench.stl.recorded.evaluation import ask
from stlbench.stl.recorded.evaluator import Compile, Traces

Samples: TypeAlias = NDArray[np.float64]


def margin_trace(formula: Formula, names: Sequence[str]) -> Callable[[Samples], Samples]:
    """Compile the robustness of `formula` at every step at which it can be told.

    Args:
        formula: any formula; intervals in steps.
        names: the signals, in the order of the samples' last axis.

    Returns:
        A pure function: traces (n, T+1, k) of floats, T >= horizon, in the signals' units -> rho (n, T+1-horizon), as
        `robustness_trace` says; it raises UndefinedError likewise.

    Raises:
        UnknownSignalError: the formula uses a signal that is not in `names`.
        ValueError: a name occurs twice.
    """
    return _compiled(formula, names, compile_margin)


def holds_trace(formula: Formula, names: Sequence[str]) -> Callable[[Samples], NDArray[np.bool_]]:
    """Compile the Boolean verdict of `formula` likewise, bool (n, T+1-horizon)."""
    signed = _compiled(formula, names, compile_signed)
    return lambda samples: signed(samples) > 0.0


def _compiled(formula: Formula, names: Sequence[str], compile_: Compile) -> Callable[[Samples], Samples]:
    require_formula(formula)
    question = ask(formula, as_names(names), compile_)

    def run(samples: Samples) -> Samples:
        last = samples.shape[1] - 1
        return question.values(Traces(samples, "strict", last), last - question.ahead)

    return run
