"""Samples as users hold them (arrays, lists, tables with named columns) to arrays of numbers."""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.errors import shorten

_NUMBERS = (Real, Decimal, np.bool_)


def as_array(values: ArrayLike, names: Sequence[str] = (), read: Collection[str] | None = None) -> NDArray[Any]:
    """`values` as an array of numbers, whose last axis has the signals `names`.

    A table with named columns is read by these names, and so is one row of it.

    Args:
        read: the signals that must be numbers; all where left out. What is no number elsewhere becomes NaN.

    Raises:
        TypeError: text, complex numbers, dates, or a masked array, whose mask NumPy would drop.
        ValueError: a table lacks a column.
    """
    masked = sys.modules.get("numpy.ma")  # `np.ma` would import it, for every trace and none that is masked
    if masked is not None and isinstance(values, masked.MaskedArray):
        raise TypeError("a masked array has samples without a value; cut them off, or put values in with filled()")
    if isinstance(values, str | bytes):
        raise TypeError(f"samples are numbers, got {type(values).__name__}")
    if type(values) is not np.ndarray and names and (labels := _labels(values)) is not None:
        values = _by_name(values, labels, names)
    array = np.asarray(values)
    if array.dtype.kind in "biuf":
        return array
    if array.dtype.kind in "OU" and array.size:
        return _numbers(np.asarray(values, dtype=object), names, read)
    if array.size:
        raise TypeError(f"samples are real numbers, got an array of {array.dtype}")
    return array.astype(np.float64)


def _labels(values: Any) -> list[Any] | None:
    """The names of a table's columns, or of the entries of one row; None where there are none."""
    for owner in ("column_names", "columns"):  # of Arrow; of pandas and Polars
        if (columns := getattr(values, owner, None)) is not None and not callable(columns):
            return list(columns)
    if hasattr(values, "to_numpy") and isinstance(getattr(values, "index", None), Collection):
        labels = list(values.index)
        return labels if any(isinstance(label, str) for label in labels) else None
    return None


def _by_name(values: Any, labels: list[Any], names: Sequence[str]) -> Any:
    for name in names:
        if labels.count(name) != 1:
            has = shorten(", ".join(map(str, labels)))
            count = "no column" if name not in labels else "several columns"
            rule = "samples in the order of the names need none: pass an array, as of to_numpy()"
            raise ValueError(f"the table has {count} {shorten(name)!r}; it has {has} ({rule})")
    return np.stack([np.asarray(values[name]) for name in names], axis=-1)


def _numbers(objects: NDArray[np.object_], names: Sequence[str], read: Collection[str] | None) -> NDArray[np.float64]:
    """Objects (..., k) as numbers; only the columns of `read` must be some."""
    by_column = bool(names) and objects.ndim > 0 and objects.shape[-1] == len(names)
    numbers = np.full(objects.shape, np.nan)
    for place in np.ndindex(objects.shape):
        value, name = objects[place], names[place[-1]] if by_column else None
        if isinstance(value, _NUMBERS):
            numbers[place] = value
        elif name is None or read is None or name in read:
            of = "" if name is None else f" of signal {shorten(name)!r}"
            raise TypeError(f"samples are numbers; a sample{of} is {type(value).__name__} {shorten(repr(value))}")
    return numbers
