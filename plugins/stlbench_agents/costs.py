"""What training takes, counted and not timed, so that the answer is the same on every machine."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from stlbench.contract import Cost

_UNIT = 40
"""Multiplications that take as long as what a unit of a layer takes beside its products, in an update: fitted to times
of `dqn` and `td3` with 16 to 6000 inputs (docs/performance-tables.md), whose ratios are met within 30 %."""
_STORED = 2 * 4
"""Bytes of an input in replay: in single precision, before and after the transition."""


def cost_of(size: int, widths: Sequence[int], outputs: int, transitions: int) -> Cost:
    """The cost of a network with `size` inputs, hidden layers and outputs, and of a replay of so many transitions."""
    products = sum(before * after for before, after in pairwise([size, *widths, outputs]))
    return Cost(replay=transitions * size * _STORED, update=float(products + _UNIT * (sum(widths) + outputs)))
