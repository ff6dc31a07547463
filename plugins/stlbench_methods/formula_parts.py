"""Parts of formulas that several methods need: windows, ranges, predicates, their values, and when a term is active."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from typing import Annotated, Any, Literal, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from stlbench import stl
from stlbench.contract import Array, Integers, Specification, Truth, Unsuitable
from stlbench.stl import Term

Window = stl.Always | stl.Eventually

EXTENSION = "absolute intervals; its source has windows in F or G[0,T]"
"""Why a formula without an outer operator is outside the form of both sources."""


def refuse_past(formula: stl.Formula) -> None:
    """Raise Unsuitable for a formula whose rewards would need samples from before the present one."""
    if (past := stl.first_past(formula)) is not None:
        place = f" at {past.position}" if past.position else ""
        raise Unsuitable(
            f"the past operator {past.operator}{place} looks back; the method takes operators that look ahead"
        )


def bounded_range(specification: Specification, psi: stl.Formula, term: object) -> tuple[float, float]:
    """The bounds of the robustness of `psi`, a part of `term`.

    Raises `Unsuitable` if it has no bounds, or if the part cannot fail or cannot hold, as `True` or `1 >= 0`.
    """
    low, high = specification.range(psi)
    if not stl.signals(psi) or math.inf in (low, -high):
        raise Unsuitable(f"{term} cannot {'fail' if low >= 0 else 'hold'}: {psi} is the same for all signals")
    if not (math.isfinite(low) and math.isfinite(high)):
        raise Unsuitable(f"the robustness of {psi} has no bounds, in {term}")
    return low, high


def leaves(phi: stl.Formula) -> Iterator[stl.Formula]:
    """The rest of a formula without its and, or, in order of appearance."""
    if isinstance(phi, stl.And | stl.Or):
        for arg in phi.args:
            yield from leaves(arg)
    else:
        yield phi


def from_first_read(phi: stl.Formula) -> tuple[int, stl.Formula]:
    """The steps before the first sample that `phi` reads, and `phi` without them.

    G[300,310] psi & F[305,320] psi is G[0,10] psi & F[5,20] psi, 300 steps later. Steps are taken away only from an
    and/or of operators F, G: any other formula is given back as it is, with 0.
    """
    windows = [leaf for leaf in leaves(phi) if isinstance(leaf, Window)]
    if len(windows) < len(list(leaves(phi))):
        return 0, phi
    first = min(window.a for window in windows)
    return first, _earlier(phi, first) if first else phi


def _earlier(phi: stl.Formula, steps: int) -> stl.Formula:
    if isinstance(phi, stl.And | stl.Or):
        return type(phi)(tuple(_earlier(arg, steps) for arg in phi.args))
    assert isinstance(phi, Window)
    return replace(phi, a=phi.a - steps, b=phi.b - steps)


def truths(predicates: Sequence[Callable[[Array], Truth]], samples: Array) -> Truth:
    """Which predicates hold at the samples (h, N, k): (number of predicates, h, N)."""
    found = np.empty((len(predicates), *samples.shape[:2]), dtype=np.bool_)
    for i, holds in enumerate(predicates):
        found[i] = holds(samples)
    return found


def scaled(values: Array, low: Array | float, high: Array | float) -> Array:
    """Values from low to high, as numbers from -1 to 1."""
    half = np.maximum(np.asarray(high) - low, 1e-9) / 2
    scaled: Array = (values - (np.asarray(high) + low) / 2) / half
    return scaled


F, G, FG = 0, 1, 2  # kinds of terms, for compiled code
KINDS = {"F": F, "G": G, "FG": FG}


class Terms(NamedTuple):
    """The n terms of a conjunction, for compiled code."""

    kinds: Integers  # (n,): `F`, `G` or `FG`
    columns: Integers  # (n,): the place of a term's flag; the counter of F G follows it
    active: Truth  # (n, T + 1): the samples of its interval
    paid: Array  # (n, 2): for the flag down and up


ValueAt = Callable[[Array, Integers], Array]  # a function of signals (..., k) and sample indices (...), giving (...)

Activity = Literal["last-deadline", "literal"]
"""`last-deadline`: term i is active on (t0_i, end_i]. t0_i is the latest end of a term that ends at or before term i
starts, and before end_i; it is 0 without such a term. Term i starts at the first step that it reads: a, or a + c2 for
F[a,c1] G[c2,b]. This gives eq. 11 for sequences and the overlap example alike. So a term of one sample is active up to
it. `literal`: term i is active on its own interval alone, as in the piecewise example of sec. III-B, and its funnel
starts at 0."""


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
    # t0 = 0 is the start of the task, and not the deadline of another term: the term is active there too.
    return np.array([((t > t0) | (t0 == 0)) & (t <= term.end) for term, t0 in zip(terms, begins, strict=True)])


def at(table: Array | Truth, t: Integers) -> Any:
    """The entries of a table (T + 1,) at the times t. A library other than NumPy, as JAX, reads it at its own times."""
    return table[t] if isinstance(t, np.ndarray) else t.__array_namespace__().asarray(table)[t]


def timeless(value: Callable[[Array], Array]) -> ValueAt:
    return lambda signals, t: value(signals)


def least_paid(least: Array, active: Truth) -> float:
    """The least that `least_active` pays from sample 1 on, from that of each term, (terms, steps + 1) or (terms, 1)."""
    paid = np.where(active, least, np.inf).min(axis=0)[1:]
    return float(np.where(np.isinf(paid), 0.0, paid).min())


def least_active(values: Sequence[ValueAt], active: Truth) -> ValueAt:
    """The minimum of the active terms' values, and 0 if no term is active (Algorithm 1, read consistently)."""
    if len(values) == 1 and active.all():
        return values[0]
    idle = np.asarray(~active.any(axis=0))
    ever_idle = bool(idle.any())

    def reward(signals: Array, t: Integers) -> Array:
        least: Array | None = None
        known = isinstance(t, np.ndarray)  # while JAX traces, nobody knows the times, and each term may be active
        for value, mask in zip(values, active, strict=True):
            now = at(mask, t)
            rows = np.count_nonzero(now) if known else -1
            if rows:
                term = value(signals, t)
                term = term if rows == t.size else np.where(now, term, np.inf)
                least = term if least is None else np.minimum(least, term)
        if least is None:
            return np.zeros(t.shape)
        return np.where(at(idle, t), 0.0, least) if ever_idle else least

    return reward


SemanticsName: TypeAlias = Literal["classic", "lse", "gilpin", "agm", "gmsr"]
Sharpness: TypeAlias = Annotated[float, Field(gt=0, le=100)]


@dataclass(frozen=True)
class Margins:
    """Margins; divided by the largest size over the box of the signals if the semantics is made for [-1, 1].

    Raises:
        Unsuitable: a margin has no bounds, as that of `True`.
    """

    specification: Specification
    semantics: stl.Semantics

    def of(self, leaf: stl.Formula) -> Callable[[Array], Array]:
        margin, unit = self.specification.margin(leaf), self._unit(leaf)
        return margin if unit == 1 else lambda samples: margin(samples) / unit

    def range(self, leaf: stl.Formula) -> tuple[float, float]:
        low, high = self.specification.range(leaf)
        return low / self._unit(leaf), high / self._unit(leaf)

    def _unit(self, leaf: stl.Formula) -> float:
        low, high = self.specification.range(leaf)
        if not (isfinite(low) and isfinite(high)):
            raise Unsuitable(f"the robustness of {leaf} has no bounds")
        return max(abs(low), abs(high)) if self.semantics.divided else 1.0


@dataclass(frozen=True)
class Truths:
    """1 if a leaf holds, else 0."""

    specification: Specification
    semantics: stl.Semantics

    def of(self, leaf: stl.Formula) -> Callable[[Array], Array]:
        holds = self.specification.holds(leaf)
        return lambda samples: holds(samples).astype(np.float64)

    def range(self, leaf: stl.Formula) -> tuple[float, float]:
        return 0.0, 1.0


Values: TypeAlias = Margins | Truths  # the values of leaves, and the semantics that combines them
