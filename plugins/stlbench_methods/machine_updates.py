"""How the runs of the machine method go on, sample by sample; compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from stlbench.contract import Array, Integers, Truth


@njit(cache=True)
def run(
    truths: Truth, starts: Integers, ends: Integers, lengths: Integers, t: Integers, weight: float, runs: Array
) -> Array:
    """Runs (N, m) go on by h samples, the first at steps t (N,), in place; what is paid at each, (h, N).

    Args:
        truths: (m, h, N), whether each term's psi holds at a sample.
        starts, ends, lengths: (m,), of the terms.
        weight: of a phase that is left, in the shaping.
    """
    _, held, rows = truths.shape
    rewards = np.zeros((held, rows))
    for row in range(rows):
        left, over = _left(lengths, runs[row])
        for sample in range(held):
            if over:
                break
            _step(truths[:, sample, row], starts, ends, lengths, t[row] + sample, runs[row])
            before = left
            left, over = _left(lengths, runs[row])
            if over:
                rewards[sample, row] = 1.0 if left == 0 else -1.0
                left = 0
            rewards[sample, row] += weight * (before - left)
    return rewards


@njit(cache=True)
def _step(truths: Truth, starts: Integers, ends: Integers, lengths: Integers, at: int, runs: Array) -> None:
    """One sample at step `at`. A term has failed, -1, once its run cannot be completed any more."""
    for i in range(len(runs)):
        if runs[i] == lengths[i]:
            continue
        if starts[i] <= at <= ends[i]:
            runs[i] = runs[i] + 1 if truths[i] else 0
        if lengths[i] - runs[i] > max(ends[i] - at, 0):
            runs[i] = -1


@njit(cache=True)
def _left(lengths: Integers, runs: Array) -> tuple[int, bool]:
    """How many phases are left, and whether all is over; where a term has failed there are some left."""
    left, failed = 0, False
    for i in range(len(runs)):
        if runs[i] < lengths[i]:
            left += 1 if runs[i] > 0 or lengths[i] == 1 else 2
            failed = failed or runs[i] < 0
    return left, failed or left == 0
