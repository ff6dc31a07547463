"""Which checkpoint is the best: a race on the starts for selection.

Satisfaction from more starts is better, and at equal satisfaction the larger mean robustness. Scoring all checkpoints
from all starts can take longer than the training. In a race all are scored from the same few starts. Then those that
are clearly behind the leader leave, and the others go on to more starts.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from stlbench.contract import Array, Integers, Truth

_FIRST = 8  # starts of the first round, or an eighth of them, whichever is more; each round doubles their number
_SURE = 3.0  # standard errors of the difference by which a checkpoint is behind that leaves
_SAFE = 5.0
"""Standard deviations over starts by which a leader's mean robustness is above 0 whose satisfaction is settled."""


class Race(NamedTuple):
    """The result for K checkpoints."""

    best: int
    starts: Integers  # (K,): from how many of the starts each was scored
    satisfaction: Array  # (K,): over these
    robustness_mean: Array  # (K,): over these


def race(play: Callable[[Integers, slice], tuple[Truth, Array]], checkpoints: int, starts: int) -> Race:
    """Find the best of K checkpoints, of equals the first.

    After a round of n starts, a checkpoint leaves if it is behind the leader by more than 3 standard errors.
    Satisfaction is compared, start by start. Where two satisfied from the same starts, robustness is compared, once
    satisfaction is settled. It is settled where the leader satisfied from no start. It is also settled where the leader
    satisfied from all, n is at least half of N, and the mean robustness is more than 5 standard deviations above 0.

    The standard error is that of a mean over n of N starts, which falls to 0 at n = N. So among checkpoints that are
    never clearly behind, the race finds the best exactly.

    Args:
        play: checkpoints (k,) and a part of the starts -> satisfied and robustness, (k, part) each.
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
    """The row of the best of k checkpoints by the same starts, both (k, n)."""
    counts, means = satisfied.sum(axis=1), robustness.mean(axis=1)
    return max(range(len(counts)), key=lambda row: (counts[row], means[row]))


def _behind(satisfied: Array, robustness: Array, starts: int) -> Truth:
    """Which of k checkpoints (k,) are clearly behind their leader by n of the starts, both (k, n)."""
    leader, n = _leader(satisfied, robustness), satisfied.shape[1]
    by_verdict = satisfied[leader] - satisfied
    alike = ~by_verdict.any(axis=1)
    with np.errstate(invalid="ignore"):  # robustness may be infinite
        ahead = np.where(alike[:, None], robustness[leader] - robustness, by_verdict)
        error = _spread(ahead) * np.sqrt(1 / n - 1 / starts)
        clearly: Truth = ahead.mean(axis=1) > _SURE * error
        safe = robustness[leader].mean() > _SAFE * _spread(robustness[leader])
    reliable = 2 * n >= starts and satisfied[leader].all() and safe
    settled = n == starts or reliable or not satisfied[leader].any()
    leaves: Truth = clearly & (~alike | settled)
    return leaves


def _spread(values: Array) -> Array:
    """The standard deviation along the last axis; infinite for one value."""
    spread: Array = values.std(axis=-1, ddof=1) if values.shape[-1] > 1 else np.full(values.shape[:-1], np.inf)
    return spread
