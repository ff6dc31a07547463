"""Sliding windows against their definition."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from helpers.generated_formulas import SEEDS
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from stlbench.stl.arithmetic.folds import slide, until


@pytest.mark.parametrize("pick", [np.minimum, np.maximum])
@pytest.mark.parametrize("dtype", [float, bool])
def test_slide_is_the_definition_at_every_width(pick: np.ufunc, dtype: type) -> None:
    values: NDArray[Any] = np.random.default_rng(0).integers(0, 2 if dtype is bool else 9, (3, 21)).astype(dtype)
    for width in range(1, 22):
        expected = np.stack([pick.reduce(values[:, t : t + width], axis=1) for t in range(22 - width)], axis=1)
        result = slide(values, width, pick)
        assert result.dtype == dtype
        np.testing.assert_array_equal(result, expected)


@given(st.integers(0, 12), st.integers(0, 20), st.integers(1, 9), st.booleans(), SEEDS)
def test_until_is_the_definition(a: int, length: int, count: int, boolean: bool, seed: int) -> None:
    b = a + length
    rng = np.random.default_rng(seed)
    left: NDArray[Any] = rng.integers(-9, 9, (2, count + b - 1))
    right: NDArray[Any] = rng.integers(-9, 9, (2, count + b - a))
    if boolean:
        left, right = left > 0, right > 4
    expected = [
        [
            max(min([right[n, t + s - a], *left[n, t : t + s]]) for s in range(a, b + 1))
            for t in range(count)
        ]
        for n in range(2)
    ]  # fmt: skip
    np.testing.assert_array_equal(until(left, right, a, count), expected)
