"""What a caller gives beside a formula, checked: samples and the names of their signals."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.errors import UnknownSignalError
from stlbench.stl.language.syntax import Expression, Formula
from stlbench.stl.language.traversal import signals


def as_array(values: ArrayLike) -> NDArray[Any]:
    """`values` as an array.

    Raises:
        TypeError: text, or a masked array, whose mask NumPy would drop without a word.
    """
    masked = sys.modules.get("numpy.ma")  # `np.ma` would import it, for every trace and none that is masked
    if masked is not None and isinstance(values, masked.MaskedArray):
        raise TypeError("a masked array has samples without a value; cut them off, or put values in with filled()")
    if isinstance(values, str | bytes):
        raise TypeError(f"samples are numbers, got {type(values).__name__}")
    return np.asarray(values)


def as_names(names: Sequence[str]) -> tuple[str, ...]:
    """`names` as a tuple. Raises TypeError for one text, which would be taken letter by letter."""
    if isinstance(names, str | bytes):
        raise TypeError(f"names is a sequence of signal names, got one text; write [{names!r}]")
    return tuple(names)


def check_names(formula: Formula | Expression, names: tuple[str, ...], where: str = "trace") -> dict[str, int]:
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
