"""An interval of a share that may be looked at after every trial: a confidence sequence.

An exact interval covers the share with its confidence if the number of trials was fixed before. Who looks after every
trial, and stops when the interval pleases, is wrong more often. A confidence sequence covers the share at all numbers
of trials at once, so that any rule to stop will do.

The trials' likelihood, averaged over shares by the beta distribution with both parameters 1/2, divided by their
likelihood at the true share, is a martingale that begins at 1. By Ville's inequality
(1939) it ever reaches 1 / (1 - level) with probability 1 - level at most. The interval has the shares at which it has
not (H. Robbins, Annals of Mathematical Statistics 41, 1970; T. L. Lai, Annals of Statistics 4, 1976).
"""

from __future__ import annotations

import math
from typing import Any

from numpy.typing import ArrayLike

from stlbench.report.statistics.intervals import Interval

_HALF = 0.5
_SMALLEST = 1e-15
"""The distance of a share to 0 or to 1 below which it is not told from it."""


def log_evidence(successes: ArrayLike, trials: ArrayLike, share: ArrayLike) -> Any:
    """Logarithm of the evidence against a share in (0, 1), from so many trials: arrays or numbers, like the arguments.

    If the share is true, it is ever above log(1 / a), after whatever number of trials, with probability a at most.
    """
    import numpy as np
    from scipy import special

    won, lost = np.asarray(successes, dtype=float), np.subtract(trials, successes, dtype=float)
    shares = np.asarray(share, dtype=float)
    mixed = special.betaln(won + _HALF, lost + _HALF) - special.betaln(_HALF, _HALF)
    return mixed - special.xlogy(won, shares) - special.xlog1py(lost, -shares)


def share_sequence(successes: int, trials: int, level: float) -> Interval:
    """Interval of a share, in [0, 1], that covers it with probability `level` at all numbers of trials at once.

    Args:
        successes: how many of the trials.
        trials: so far, at least 0. They are independent, each a success with the probability that is asked for.
        level: confidence, in (0, 1).
    """
    limit = math.log(1 / (1 - level))
    if not trials:
        return Interval(0.0, 1.0)
    share = successes / trials
    low = 0.0 if successes == 0 else _crossing(successes, trials, limit, _SMALLEST, min(share, 1 - _SMALLEST))
    high = 1.0 if successes == trials else _crossing(successes, trials, limit, 1 - _SMALLEST, max(share, _SMALLEST))
    return Interval(low, high)


def _crossing(successes: int, trials: int, limit: float, outer: float, inner: float) -> float:
    """Where, between a share that is refuted and one that is not, the evidence reaches the limit."""
    from scipy import optimize

    def beyond(share: float) -> float:
        return float(log_evidence(successes, trials, share)) - limit

    return outer if beyond(outer) <= 0 else float(optimize.brentq(beyond, outer, inner, xtol=1e-12))
