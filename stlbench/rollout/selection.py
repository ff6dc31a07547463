"""Which checkpoint is the best: a race on the starts that are kept for selection.

A checkpoint is better than another if it satisfies the formula from more of the starts; of two that satisfy it from
equally many, the one of the larger mean robustness is. To score all of them from all starts takes longer than to train
where a simulation is dear. In a race all are scored from a few starts, the same for all; those that are clearly behind
the leader leave, and the others go on to more.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from stlbench.contract import Array, Integers, Truth

__all__ = ["Race", "race"]

_FIRST = 8
"""Starts of the first round, or an eighth of them, whichever is more; each round doubles their number."""
_SURE = 3.0
"""Standard errors of the difference by which a checkpoint is behind that leaves."""


class Race(NamedTuple):
    """What came of K checkpoints."""

    best: int
    starts: Integers
    """(K,): from how many of the starts each was scored."""
    satisfaction: Array
    """(K,): over these."""
    robustness_mean: Array
    """(K,): over these."""


def race(play: Callable[[Integers, slice], tuple[Truth, Array]], checkpoints: int, starts: int) -> Race:
    """Find the best of some checkpoints, of equals the first.

    A checkpoint leaves after a round of n starts if it is behind the leader of that round by more than 3 standard
    errors. What is compared, start by start, is satisfaction; or robustness, where the two satisfied from the very
    same starts. The error is that of a mean over n of all N starts, which falls to 0 as n comes to N: of those that
    are never clearly behind, the best is found by all starts, exactly.

    Args:
        play: from checkpoints (k,) and a part of the starts to whether they satisfied, and their robustness, (k, part).
        checkpoints: K, at least 1.
        starts: N; any first part of them must be as even as the whole, as that of a Halton sequence is.
    """
    satisfied, robustness = np.zeros((checkpoints, starts)), np.zeros((checkpoints, starts))
    scored, left = np.zeros(checkpoints, dtype=np.int64), np.arange(checkpoints)
    for part in _rounds(starts):
        satisfied[left, part], robustness[left, part] = play(left, part)
        scored[left] = n = part.stop
        left = left[~_behind(satisfied[left, :n], robustness[left, :n], starts)]
        if len(left) == 1:
            break
    return Race(
        int(left[_leader(satisfied[left], robustness[left])]),
        scored,
        satisfied.sum(axis=1) / scored,
        robustness.sum(axis=1) / scored,
    )


def _rounds(starts: int) -> Iterator[slice]:
    begin, end = 0, max(_FIRST, -(-starts // 8))
    while begin < starts:
        yield slice(begin, min(end, starts))
        begin, end = end, 2 * end


def _leader(satisfied: Array, robustness: Array) -> int:
    """The best of k checkpoints by the same starts, both (k, n): its row."""
    counts, means = satisfied.sum(axis=1), robustness.mean(axis=1)
    return max(range(len(counts)), key=lambda row: (counts[row], means[row]))


def _behind(satisfied: Array, robustness: Array, starts: int) -> Truth:
    """Which of k checkpoints are clearly behind their leader by n of the starts, both (k, n): (k,)."""
    leader, n = _leader(satisfied, robustness), satisfied.shape[1]
    with np.errstate(invalid="ignore"):  # robustness may be infinite
        by_verdict, by_robustness = satisfied[leader] - satisfied, robustness[leader] - robustness
        behind = np.where(by_verdict.any(axis=1, keepdims=True), by_verdict, by_robustness)
        mean, spread = behind.mean(axis=1), behind.std(axis=1, ddof=1 if n > 1 else 0)
    error = spread * np.sqrt(1 / n - 1 / starts)
    clearly: Truth = mean > _SURE * error
    return clearly
