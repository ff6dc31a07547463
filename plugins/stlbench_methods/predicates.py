"""The truth of several predicates along samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from stlbench.contract import Array, Truth


def truths(predicates: Sequence[Callable[[Array], Truth]], samples: Array) -> Truth:
    """Which predicates hold at the samples (h, N, k): (number of predicates, h, N)."""
    found = np.empty((len(predicates), *samples.shape[:2]), dtype=np.bool_)
    for i, holds in enumerate(predicates):
        found[i] = holds(samples)
    return found
