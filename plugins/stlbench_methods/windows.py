"""Parts of formulas that several methods need: windows, ranges, predicates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Specification, Truth, Unsuitable

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

    Raises `Unsuitable` where it has no bounds, or where the part cannot fail or cannot hold, as `True` or `1 >= 0`.
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
    columns: Integers  # (n,): where a term's flag is; the counter of F G follows it
    active: Truth  # (n, T + 1): the samples of its interval
    paid: Array  # (n, 2): for the flag down and up
