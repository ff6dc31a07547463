"""Sliding minimum, maximum and timed until along the last axis, over a batch, by doubling: O(T log w).

A window of width w is covered by two windows of width 2^j <= w, which may overlap because min and max do not count.
Rows are worked on laid end to end, several times faster than row by row; what crosses a row's end is left out at last.
Works on float (robustness) and bool (Boolean semantics: minimum is and, maximum is or) arrays alike.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Values = NDArray[Any]


def slide(values: Values, width: int, pick: np.ufunc) -> Values:
    """`pick` (np.minimum or np.maximum) over every window of `width` samples.

    values (..., m) with m >= width >= 1 -> (..., m - width + 1).
    """
    count = values.shape[-1] - width + 1
    if count == 1:
        return pick.reduce(values, axis=-1, keepdims=True)  # type: ignore[no-any-return]
    flat, size = values.reshape(-1), 1
    while 2 * size <= width:
        flat = pick(flat[:-size], flat[size:])
        size *= 2
    if size < width:
        flat = pick(flat[: size - width], flat[width - size :])
    return _rows(flat, values.shape, count)


def until(left: Values, right: Values, a: int, count: int) -> Values:
    """`left U[a,b] right` at `count` steps t: max over t' in [t+a, t+b] of min(right(t'), min of left on [t, t')).

    left (..., count + b - 1) begins at step 0, and is not read if b = 0; right (..., count + b - a) begins at step a.
    Split at a, exactly: left holds on [t, t+a), and from t + a on an until with the interval [0, b - a].
    """
    width = right.shape[-1] - count + 1
    if count == 1:
        return _first_until(left, right, a)
    result = _prompt_until(left[..., a:], right, width)
    if a > 0:
        result = np.minimum(result, slide(left[..., : count + a - 1], a, np.minimum))
    return result


def _prompt_until(left: Values, right: Values, width: int) -> Values:
    """Until with the interval [0, width - 1], by doubling; rows of left may be one sample shorter than those of right.

    With U over [t, t+s) and L the minimum of left over the same steps, U over [t, t+2s) is max(U, min(L, U(t+s))). An
    overlap in the last round is harmless: it repeats candidates with more of left in their minimum.
    """
    guard = np.empty_like(right)
    guard[..., :-1], guard[..., -1] = left[..., : right.shape[-1] - 1], right[..., -1]  # the last is not read
    low, best, size = guard.reshape(-1), right.reshape(-1), 1
    while size < width:
        step = min(size, width - size)
        later = np.minimum(low[:-step], best[step:])
        best = np.maximum(best[:-step], later, out=later)
        low = np.minimum(low[:-step], low[step:])
        size += step
    return _rows(best, right.shape, right.shape[-1] - width + 1)


def _rows(flat: Values, shape: tuple[int, ...], count: int) -> Values:
    """The first `count` of each row of an array of `shape` whose rows `flat` has one after the other, as a view."""
    item = flat.itemsize
    strides = [item * math.prod(shape[axis + 1 :]) for axis in range(len(shape))]
    return np.ndarray((*shape[:-1], count), flat.dtype, np.ascontiguousarray(flat), strides=strides)


def _first_until(left: Values, right: Values, a: int) -> Values:
    """Until at one step: one running minimum of left, which is then compared with right one step later."""
    b = a + right.shape[-1] - 1
    if b == 0:
        return right
    before = np.minimum.accumulate(left[..., :b], axis=-1)
    if a > 0:
        return np.minimum(right, before[..., a - 1 :]).max(axis=-1, keepdims=True)  # type: ignore[no-any-return]
    later = np.minimum(right[..., 1:], before).max(axis=-1, keepdims=True)
    first: Values = np.maximum(right[..., :1], later)
    return first
