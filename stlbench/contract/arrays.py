"""Types of arrays. Import them from `stlbench.contract`."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Truth = NDArray[np.bool_]
Arrays = Mapping[str, NDArray[Any]]
"""Arrays by name: numbers, or short texts, of any shape; no objects."""


def are_numbers(values: Any) -> bool:
    """Whether values are real numbers, none of them masked. NumPy would make floats of texts and times."""
    if type(values) is np.ndarray:
        return values.dtype.kind in "biuf"
    return not isinstance(values, np.ma.MaskedArray) and np.asarray(values).dtype.kind in "biuf"


def kind_of(values: Any) -> str:
    """The type of values for a message: "complex128", "a masked array"."""
    return "a masked array" if isinstance(values, np.ma.MaskedArray) else str(np.asarray(values).dtype)
