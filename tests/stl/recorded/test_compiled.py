"""Formulas compiled once for short traces: what `robustness_trace` and `satisfied_trace` say."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.generated_formulas import NAMES, SEEDS, formulas, traces
from hypothesis import given

from stlbench.stl import (
    Formula,
    UndefinedError,
    holds_trace,
    horizon,
    margin_trace,
    parse,
    robustness_trace,
    satisfied_trace,
)


def test_by_hand() -> None:
    # windows of two samples of x = 1 0 3 2, and of -x
    samples = np.array([[[1.0], [0.0], [3.0], [2.0]], [[-1.0], [0.0], [-3.0], [-2.0]]])
    formula = parse("G[0,1] x >= 0")
    assert margin_trace(formula, ["x"])(samples).tolist() == [[0, 0, 2], [-1, -3, -3]]
    assert holds_trace(formula, ["x"])(samples).tolist() == [[True] * 3, [False] * 3]
    assert holds_trace(parse("F[1,2] x > 0"), ["x"])(samples).tolist() == [[True, True], [False, False]]


@given(formulas(), SEEDS)
def test_equals_the_checked_ones(formula: Formula, seed: int) -> None:
    steps = horizon(formula) + 4
    samples = np.stack([traces(steps, seed), traces(steps, seed + 1)])
    rho, verdict = margin_trace(formula, NAMES)(samples), holds_trace(formula, NAMES)(samples)
    assert np.array_equal(rho, robustness_trace(formula, samples, NAMES))
    assert np.array_equal(verdict, satisfied_trace(formula, samples, NAMES))
    assert verdict.dtype == bool


def test_a_sample_without_a_value_is_an_error_where_it_is_read() -> None:
    samples = np.array([[[1.0], [1.0], [np.nan]]])
    for compiled in (margin_trace(parse("G[0,1] x >= 0"), ["x"]), holds_trace(parse("G[0,1] x >= 0"), ["x"])):
        with pytest.raises(UndefinedError, match=r"^signal 'x' is NaN at sample 2 of trace 0$"):
            compiled(samples)
        assert compiled(samples[:, :2]).shape == (1, 1)
