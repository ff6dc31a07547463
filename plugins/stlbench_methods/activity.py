"""When a term of the formula is active, and how rewards of active terms become one (Saxena et al., sec. III-B)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

from stlbench.contract import Array, Integers, Truth
from stlbench.stl import Term

Value = Callable[[Array, Integers], Array]  # a function of signals (..., k) and sample indices (...), giving (...)

Activity = Literal["last-deadline", "literal"]
"""`last-deadline`: term i is active on (t0_i, end_i], t0_i the latest end of a term that ends at or before term i
starts (the first step that it reads: a, or a + c2 for F[a,c1] G[c2,b]) and before end_i, else 0; this gives eq. 11 for
sequences and the overlap example alike. So a term of one sample is active up to it. `literal`: term i is active on its
own interval alone, as in the piecewise example of sec. III-B, and its funnel starts at 0."""


def active_from(terms: Sequence[Term], activity: Activity) -> list[int]:
    """t0 of each term: the time from which its funnel runs."""
    if activity == "literal":
        return [0 for _ in terms]
    ends = {term.end for term in terms}
    return [max((end for end in ends if end <= term.start and end < term.end), default=0) for term in terms]


def active_table(terms: Sequence[Term], steps: int, activity: Activity) -> Truth:
    """Whether term i is active at sample t: (number of terms, steps + 1)."""
    t = np.arange(steps + 1)
    if activity == "literal":
        return np.array([(term.start <= t) & (t <= term.end) for term in terms])
    begins = active_from(terms, activity)
    return np.array([((t > t0) | (t0 == 0)) & (t <= term.end) for term, t0 in zip(terms, begins, strict=True)])


def timeless(value: Callable[[Array], Array]) -> Value:
    return lambda signals, t: value(signals)


def least_paid(least: Array, active: Truth) -> float:
    """The least that `least_active` pays from sample 1 on, from that of each term, (terms, steps + 1) or (terms, 1)."""
    paid = np.where(active, least, np.inf).min(axis=0)[1:]
    return float(np.where(np.isinf(paid), 0.0, paid).min())


def least_active(values: Sequence[Value], active: Truth) -> Value:
    """The minimum of the active terms' values, and 0 where no term is active (Algorithm 1, read consistently)."""
    if len(values) == 1 and active.all():
        return values[0]
    idle = np.asarray(~active.any(axis=0))
    ever_idle = bool(idle.any())

    def reward(signals: Array, t: Integers) -> Array:
        least: Array | None = None
        for value, mask in zip(values, active, strict=True):
            now = mask[t]
            rows = np.count_nonzero(now)
            if rows:
                term = value(signals, t)
                term = term if rows == t.size else np.where(now, term, np.inf)
                least = term if least is None else np.minimum(least, term)
        if least is None:
            return np.zeros(t.shape)
        return np.where(idle[t], 0.0, least) if ever_idle else least

    return reward
