"""Random numbers for systems, which may draw none: a function of a seed and a count, both columns of the state.

The bits of the seed are mixed once, the count is added in multiples of an odd constant, and the sum is mixed again: the
generator SplitMix64 (Steele, Lea, Flood, OOPSLA 2014), entered at any place of its sequence. Box and Muller make pairs
of normal numbers of pairs of uniform ones.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array

_Bits = NDArray[np.uint64]
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_MIXING = ((30, np.uint64(0xBF58476D1CE4E5B9)), (27, np.uint64(0x94D049BB133111EB)))


def normal(seed: Array, count: Array, columns: int) -> Array:
    """Standard normal numbers (N, columns), the same for the same seed (N,) and count (N,), whole and not negative.

    Numbers of different counts, of different seeds and in different columns are as good as independent. Any float
    is a seed.
    """
    pairs = (columns + 1) // 2
    first: _Bits = np.multiply(count.astype(np.uint64), np.uint64(2 * pairs))
    place: _Bits = np.add.outer(first, np.arange(1, 2 * pairs + 1, dtype=np.uint64))
    key = _mixed(np.ascontiguousarray(seed + 0.0).view(np.uint64))  # 0 and -0 are one seed
    uniform = ((_mixed(key[:, None] + place * _GOLDEN) >> np.uint64(11)) + 0.5) * 2.0**-53
    radius, angle = np.sqrt(-2 * np.log(uniform[:, :pairs])), 2 * np.pi * uniform[:, pairs:]
    return np.concatenate([radius * np.cos(angle), radius * np.sin(angle)], axis=1)[:, :columns]


def _mixed(bits: _Bits) -> _Bits:
    """Each number's bits, every one of which depends on every one before."""
    for shift, factor in _MIXING:
        bits = (bits ^ (bits >> np.uint64(shift))) * factor
    return bits ^ (bits >> np.uint64(31))
