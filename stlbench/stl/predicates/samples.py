"""Samples as users hold them (arrays, lists, tables with named columns) to arrays of numbers."""

from __future__ import annotations

import sys
from collections.abc import Collection, Sequence
from decimal import Decimal
from numbers import Integral, Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.errors import shorten

_NUMBERS = (Real, Decimal, np.bool_)
#: up to here all whole numbers are floats, and no two of them the same one
EXACT = 2**53
NO_FLOAT = (
    "is no float: above 2**53 not all whole numbers are. Subtract the first value from all, or take a larger unit"
)


def as_array(values: ArrayLike, names: Sequence[str] = (), read: Collection[str] | None = None) -> NDArray[Any]:
    """`values` as an array of numbers, whose last axis has the signals `names`.

    A table with named columns is read by these names, and so is one row of it.

    Args:
        read: the signals that must be numbers; all where left out. What is no number elsewhere becomes NaN.

    Raises:
        TypeError: text, complex numbers, dates, or a masked array, whose mask NumPy would drop.
        ValueError: a table lacks a column, or a whole number that is read would be rounded to a float.
    """
    if type(values) is np.ndarray and values.dtype.kind == "f":
        return values
    masked = sys.modules.get("numpy.ma")  # `np.ma` would import it, for every trace and none that is masked
    several = isinstance(values, list | tuple)
    parts: Any = values if several else [values]
    if masked is not None and any(isinstance(part, masked.MaskedArray) for part in parts):
        raise TypeError("a masked array has samples without a value; cut them off, or put values in with filled()")
    if isinstance(values, str | bytes):
        raise TypeError(f"samples are numbers, got {type(values).__name__}")
    if type(values) is not np.ndarray and names and (labels := _labels(values)) is not None:
        values = _by_name(values, labels, names, read)
    array = np.asarray(values)
    if several and array.dtype.kind == "f" and (np.abs(array) >= EXACT).any():  # some may be whole numbers, rounded
        return _numbers(np.asarray(values, dtype=object), names, read)
    if array.dtype.kind in "biuf":
        _refuse_rounding(array, names, read)
        return array
    if array.dtype.kind in "OU" and array.size:
        return _numbers(np.asarray(values, dtype=object), names, read)
    if array.size:
        raise TypeError(f"samples are real numbers, got an array of {array.dtype}")
    return array.astype(np.float64)


def as_floats(values: ArrayLike, names: Sequence[str], read: Collection[str] | None) -> NDArray[np.float64]:
    """The same as floats: in the arithmetic of integers 1 - 2 may be 255."""
    return np.asarray(as_array(values, names, read), dtype=np.float64)


def _labels(values: Any) -> list[Any] | None:
    """The names of a table's columns, or of the entries of one row; None where there are none."""
    for owner in ("column_names", "columns"):  # of Arrow; of pandas and Polars
        if (columns := getattr(values, owner, None)) is not None and not callable(columns):
            return list(columns)
    if hasattr(values, "to_numpy") and isinstance(getattr(values, "index", None), Collection):
        labels = list(values.index)
        return labels if any(isinstance(label, str) for label in labels) else None
    return None


def _by_name(values: Any, labels: list[Any], names: Sequence[str], read: Collection[str] | None) -> Any:
    for name in names:
        if labels.count(name) != 1:
            has = shorten(", ".join(map(str, labels)))
            count = "no column" if name not in labels else "several columns"
            rule = "samples in the order of the names need none: pass an array, as of to_numpy()"
            raise ValueError(f"the table has {count} {shorten(name)!r}; it has {has} ({rule})")
    columns = [np.asarray(values[name]) for name in names]
    for name, column in zip(names, columns, strict=True):  # whole numbers beside floats become floats
        _refuse_rounding(column[..., None], [name], read)
    return np.stack(columns, axis=-1)


def _refuse_rounding(array: NDArray[Any], names: Sequence[str], read: Collection[str] | None) -> None:
    """Raise ValueError at a whole number that is read and is no float; only integers of 64 bits may have one."""
    if array.dtype.kind not in "iu" or array.dtype.itemsize < 8 or not array.size:
        return
    if array.max() <= EXACT and array.min() >= -EXACT:
        return
    for place in map(tuple, np.argwhere((array > EXACT) | (array < -EXACT)).tolist()):
        name = _signal(array, place, names)
        if _is_read(name, read):
            _exactly(int(array[place]), place, name)


def _numbers(objects: NDArray[np.object_], names: Sequence[str], read: Collection[str] | None) -> NDArray[np.float64]:
    """Objects (..., k) as numbers; only the columns of `read` must be some."""
    numbers = np.full(objects.shape, np.nan)
    for place in np.ndindex(objects.shape):
        value, name = objects[place], _signal(objects, place, names)
        if not _is_read(name, read):
            continue
        if not isinstance(value, _NUMBERS):
            of = "" if name is None else f" of signal {shorten(name)!r}"
            raise TypeError(f"samples are numbers; a sample{of} is {type(value).__name__} {shorten(repr(value))}")
        numbers[place] = _exactly(int(value), place, name) if isinstance(value, Integral) else value
    return numbers


def _signal(array: NDArray[Any], place: tuple[int, ...], names: Sequence[str]) -> str | None:
    return names[place[-1]] if names and array.ndim > 0 and array.shape[-1] == len(names) else None


def _is_read(name: str | None, read: Collection[str] | None) -> bool:
    return name is None or read is None or name in read


def _exactly(value: int, place: tuple[int, ...], name: str | None) -> float:
    """A whole number as a float; ValueError where that is another number."""
    try:
        if (number := float(value)) == value:
            return number
    except OverflowError:
        pass
    signal = "a sample" if name is None else f"signal {shorten(name)!r}"
    where = (f" at sample {place[-2]}" if len(place) > 1 else "") + (f" of trace {place[0]}" if len(place) > 2 else "")
    shown = shorten(str(value)) if abs(value) < 10**400 else "more than 1e400"
    raise ValueError(f"{signal} is {shown}{where}, which {NO_FLOAT}")
