"""The time as a policy sees it."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array


def scaled_times(steps: int) -> Array:
    """The times 0..steps, from -1 to 1: (steps + 1, 1)."""
    return np.arange(steps + 1, dtype=np.int64)[:, None] * np.float64(2.0 / steps) - 1.0
