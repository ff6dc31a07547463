"""Sound bounds of a margin over a box of signals, after a proof that it has a value all over the box."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from stlbench.arithmetic.functions import OPERATIONS, Domain
from stlbench.stl.boxes.search import Maximum, Search
from stlbench.stl.errors import UndefinedError
from stlbench.stl.language.expressions import Binary, Call, Expression, Signal
from stlbench.stl.language.structure import as_names, check_names, require_pointwise, signals, walk
from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates import margin
from stlbench.stl.predicates.samples import as_array
from stlbench.stl.recorded.evaluator import cause


@dataclass(frozen=True)
class Bounds:
    """Proven bounds of a margin over a box: it lies in [low, high] at every point; the errors say how tight that is."""

    low: float
    high: float
    low_error: float
    """The least margin is at most this far above `low`, as a point of the box shows (to rounding); inf if none does."""
    high_error: float
    """The greatest margin is at most this far below `high`, likewise."""
    tolerance: float
    """The tolerance that was given."""

    @property
    def tight(self) -> bool:
        """Whether both ends are within the tolerance."""
        return self.low_error <= self.tolerance and self.high_error <= self.tolerance


def bounds(
    psi: Formula,
    box: Mapping[str, tuple[float, float]] | ArrayLike,
    names: Sequence[str] | None = None,
    tolerance: float = 1e-6,
    nodes: int = 200_000,
) -> Bounds:
    """Bounds of the margin of `psi` over `box`: rho_min and rho_max of the paper.

    The interval provably contains the margin at every point of the box (in real arithmetic; interval ends are rounded
    outwards). Each end is within `tolerance` of the true extreme where the allowed work suffices. With many signals, or
    many occurrences of one signal, the ends may be wider: they are sound, and the errors say by how much at most.

    Args:
        psi: a formula without temporal operators.
        box: {signal: (low, high)}, finite; or an array (k, 2) for the signals `names`. Extra signals are ignored.
        names: the signals of an array `box`, in order.
        tolerance: absolute, in the unit of the margin, > 0.
        nodes: how many boxes may be examined for each end, >= 1; fewer are for a formula of many parts and signals.

    Raises:
        UnknownSignalError: psi uses a signal that the box does not have.
        UndefinedError: a square root, a logarithm, a tangent or a division is not defined all over the box; or the
            margin has no bounds and, in floats, no value at the middle or a corner, as with inf - inf.
        TypeError: a masked array.
        ValueError: psi has temporal operators, or an end of the box is not finite or low > high.
    """
    require_pointwise(psi)
    if not tolerance > 0:
        raise ValueError(f"tolerance must be positive, got {tolerance}")
    ends = _ends(psi, box, names)
    with np.errstate(all="ignore"):
        search = _with_proven_domains(psi, Search(ends, tolerance, nodes))
        lowest, highest = search.extremes(psi)
        if not (np.isfinite(lowest.bound) and np.isfinite(highest.bound)):
            _refuse_undefined(psi, ends)
    return Bounds(-lowest.bound, highest.bound, _error(lowest), _error(highest), tolerance)


def _refuse_undefined(psi: Formula, ends: Mapping[str, tuple[float, float]]) -> None:
    names, box = tuple(ends), np.array(list(ends.values())).reshape(-1, 2)
    for point in (box.mean(axis=1), box[:, 0], box[:, 1]):
        if np.isnan(margin(psi, names)(point)):
            raise UndefinedError(cause(psi, names, point))


def _error(maximum: Maximum) -> float:
    return maximum.bound - maximum.reached if maximum.bound > maximum.reached else 0.0


def _ends(
    psi: Formula, box: Mapping[str, tuple[float, float]] | ArrayLike, names: Sequence[str] | None
) -> dict[str, tuple[float, float]]:
    if not isinstance(box, Mapping):
        if names is None:
            raise ValueError("an array of bounds needs the signals' names")
        rows = np.asarray(as_array(box), dtype=float)
        if rows.shape != (len(names), 2):
            raise ValueError(f"bounds of {len(names)} signals have shape ({len(names)}, 2), got {rows.shape}")
        box = {name: (low, high) for name, (low, high) in zip(names, rows.tolist(), strict=True)}
    check_names(psi, as_names(tuple(box), psi, "box"), "box")
    ends = {name: (float(low), float(high)) for name in signals(psi) for low, high in [as_array(box[name])]}
    for name, (low, high) in ends.items():
        if not (np.isfinite(low) and np.isfinite(high) and low <= high):
            raise ValueError(f"bounds of {name!r} must be finite with low <= high, got [{low}, {high}]")
    return ends


#: boxes examined to tell an argument that touches the end of its domain from one that leaves it
TOUCHING = 20_000


def _with_proven_domains(psi: Formula, search: Search) -> Search:
    """The search, with the proven ranges of all arguments that have a domain, inner ones first.

    All these proofs together take the work of one extreme.

    Raises:
        UndefinedError: an argument may leave its domain. One that touches the end of a closed domain, as in
            sqrt(1 - x * x) on [-1, 1], may do so by the tolerance in the proof, but at no point that is looked at.
    """
    limited = _limited(psi)
    count = max(1, len(limited))
    share = replace(search, boxes=search.boxes // count, work=search.work // count)
    for (arg, domain), whole in reversed(limited.items()):
        share.proven[arg] = _proven(arg, domain, whole, share)
    return replace(search, proven=share.proven)


def _limited(psi: Formula) -> dict[tuple[Expression, Domain], Expression]:
    """Arguments that have a domain, each with where it stands, outer ones first. The compiler checks constants."""
    limited: dict[tuple[Expression, Domain], Expression] = {}
    for node in walk(psi):
        match node:
            case Call(name, (*_, arg)) | Binary(name, _, arg) if (domain := OPERATIONS[name].domain) is not None:
                limited[arg, domain] = node
    return {key: node for key, node in limited.items() if any(isinstance(part, Signal) for part in walk(key[0]))}


def _proven(arg: Expression, domain: Domain, whole: Expression, search: Search) -> tuple[float, float]:
    lowest, highest = search.extremes(arg)
    low, high = -lowest.bound, highest.bound
    if not domain.may_leave(low, high):
        return low, high
    least = domain.least
    touches = least is not None and low >= least - search.tolerance
    if least is None or not touches or search.falls_below(arg, least, min(TOUCHING, search.boxes)):
        raise UndefinedError(
            f"{whole} is not defined all over the box: {arg} must be {domain.words} and may be from {low:g} to {high:g}"
        )
    return max(low, least), max(high, least)
