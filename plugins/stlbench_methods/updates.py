"""The memories of flag and machine, sample by sample; compiled."""

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit

from stlbench.contract import Array, Integers, Truth, cached
from stlbench_methods.formula_parts import FG, F, G, Terms

Function = TypeVar("Function", bound=Callable[..., Any])


def compiled(function: Function) -> Function:
    return cast(Function, cached(njit(function)))


@compiled
def count(truths: Truth, eventually: Truth, full: Array, flags: Array) -> None:
    """Counters (N, m) of windows go on by h samples; `truths` (m, h, N) become the windows' verdicts after each.

    F: full at a sample where psi holds, one less at each other; positive iff psi held among the last `full`.
    G: one more at each sample where psi holds, 0 at any other; full iff psi held at each of the last `full`.
    """
    for i in range(truths.shape[0]):
        for sample in range(truths.shape[1]):
            for row in range(truths.shape[2]):
                flag, holds = flags[row, i], truths[i, sample, row]
                if eventually[i]:
                    flag = full[i] if holds else max(flag - 1, 0.0)
                    truths[i, sample, row] = flag > 0
                else:
                    flag = min(flag + 1, full[i]) if holds else 0.0
                    truths[i, sample, row] = flag == full[i]
                flags[row, i] = flag


@compiled
def latch(truths: Truth, terms: Terms, full: Array, t: Integers, flags: Array) -> Array:
    """Flags (N, m) of terms with absolute intervals go on by h samples, the first at steps t (N,): paid (h, N)."""
    terms_count, held, rows = truths.shape
    rewards = np.zeros((held, rows))
    for i in range(terms_count):
        kind, at = terms.kinds[i], terms.columns[i]
        for sample in range(held):
            for row in range(rows):
                if not terms.active[i, t[row] + sample]:
                    if kind == FG:  # a run counts within its interval alone
                        flags[row, at + 1] = 0
                    continue
                holds = truths[i, sample, row]
                if kind == G:
                    flags[row, at] = flags[row, at] if holds else 0
                elif kind == F:
                    flags[row, at] = 1 if holds else flags[row, at]
                else:
                    flags[row, at + 1] = min(flags[row, at + 1] + 1, full[at + 1]) if holds else 0
                    if flags[row, at + 1] == full[at + 1]:
                        flags[row, at] = 1
                rewards[sample, row] += terms.paid[i, int(flags[row, at])]
    return rewards


@compiled
def run(
    truths: Truth, starts: Integers, ends: Integers, lengths: Integers, t: Integers, weight: float, runs: Array
) -> Array:
    """Runs (N, m) go on by h samples, the first at steps t (N,), in place. The pay at each, (h, N).

    `truths` (m, h, N) says whether each psi holds; `weight` is that of a phase that is left, in the shaping.
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


@compiled
def _step(truths: Truth, starts: Integers, ends: Integers, lengths: Integers, at: int, runs: Array) -> None:
    """One sample at step `at`. A term has failed, -1, once its run cannot be completed any more."""
    for i in range(len(runs)):
        if runs[i] == lengths[i]:
            continue
        if starts[i] <= at <= ends[i]:
            runs[i] = runs[i] + 1 if truths[i] else 0
        if lengths[i] - runs[i] > max(ends[i] - at, 0):
            runs[i] = -1


@compiled
def _left(lengths: Integers, runs: Array) -> tuple[int, bool]:
    """The number of phases that are left, and whether all is over; a term that has failed has some left."""
    left, failed = 0, False
    for i in range(len(runs)):
        if runs[i] < lengths[i]:
            left += 1 if runs[i] > 0 or lengths[i] == 1 else 2
            failed = failed or runs[i] < 0
    return left, failed or left == 0
