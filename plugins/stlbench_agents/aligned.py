"""Arrays that begin where a line of the processor's cache does.

NumPy's begin anywhere on a multiple of 16 bytes. Then most vectors of 64 bytes lie in two lines, and loops over whole
arrays, such as Adam's, take longer.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

_LINE = 64
"""Bytes of a line."""


def zeros(shape: int | tuple[int, ...], dtype: Any = np.float32) -> NDArray[Any]:
    """As `numpy.zeros`, row by row."""
    size = np.dtype(dtype).itemsize * int(np.prod(shape))
    memory = np.zeros(size + _LINE, np.uint8)
    begin = -memory.ctypes.data % _LINE
    array: NDArray[Any] = memory[begin : begin + size].view(dtype).reshape(shape)
    return array


def aligned(values: NDArray[Any]) -> NDArray[Any]:
    """A copy."""
    copy = zeros(values.shape, values.dtype)
    copy[...] = values
    return copy
