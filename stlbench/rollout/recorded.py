"""Where the samples of traces from a file end."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array, Integers, Truth


def last_recorded(traces: Array) -> Integers:
    """The last row of each of traces (N, T + 1, k) that is not NaN in all signals, (N,); T where all rows are."""
    missing: Truth = np.logical_and.reduce(np.isnan(traces), axis=2)
    last: Integers = traces.shape[1] - 1 - np.argmin(missing[:, ::-1], axis=1)
    return last
