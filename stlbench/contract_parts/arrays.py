"""Arrays, as everything of the contract has them. Import them from `stlbench.contract`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Arrays", "Integers", "Truth"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Truth = NDArray[np.bool_]
Arrays = Mapping[str, NDArray[Any]]
"""By name: numbers, or short texts, of any shape; no objects."""
