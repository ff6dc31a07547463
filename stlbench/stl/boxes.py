"""Sound bounds of a margin over a box of signals, by interval branch and bound, after a proof that it has a value
all over the box.

Plain interval arithmetic takes each operation by itself. The mean-value form takes the whole: by the mean value theorem
(for Lipschitz functions, with Clarke's generalised gradient), on a box X with middle c, f(X) lies in
f(c) + sum_i df/dx_i(X) (X_i - c_i). Its error falls with the square of the box, where that of plain interval arithmetic
falls linearly; it is what proves x - x = 0.

Interval arithmetic over-estimates where a signal occurs more than once, and the less so the smaller the box. So the
boxes whose upper ends are highest are split until those are close enough to a value that is reached at some point.
Points only decide what to drop; the result is always an interval end.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import NamedTuple, TypeAlias, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.arithmetic.derivatives import Derivatives, negated, of_difference
from stlbench.stl.arithmetic.functions import OPERATIONS, Domain
from stlbench.stl.arithmetic.intervals import Range, difference, negative, power, product, total
from stlbench.stl.errors import UndefinedError, shorten
from stlbench.stl.language.expressions import Binary, Call, Expression, Negative, Number, Signal
from stlbench.stl.language.structure import as_names, check_names, require_pointwise, signals, walk
from stlbench.stl.language.syntax import AnyNode, Connective, Formula, Not, Predicate, TrueFormula
from stlbench.stl.predicates import as_array, compile_arrays, margin
from stlbench.stl.recorded.evaluator import cause

T = TypeVar("T")
#: each signal's interval on each box: ends (m,)
Boxes: TypeAlias = dict[str, Range]
#: proven ranges of subexpressions whose own interval may be too wide (arguments of sqrt and divisors)
Proven: TypeAlias = dict[AnyNode, tuple[float, float]]


def enclosure(target: AnyNode, boxes: Boxes, proven: Proven) -> Range:
    rates = Enclosure(boxes, proven, with_derivatives=True)
    plain, centred = rates.range(target), mean_value_range(target, boxes, proven, rates)
    return np.fmax(plain[0], centred[0]), np.fmin(plain[1], centred[1])


def mean_value_range(target: AnyNode, boxes: Boxes, proven: Proven, rates: Enclosure | None = None) -> Range:
    """The mean-value form on each box, NaN where no derivative bounds it; `rates` are the derivatives on `boxes`."""
    rates = rates or Enclosure(boxes, proven, with_derivatives=True)
    middles = {name: low / 2 + high / 2 for name, (low, high) in boxes.items()}
    at = {name: (middle, middle) for name, middle in middles.items()}
    centre = Enclosure(at, proven).range(target)
    steps = [
        product(derivative, difference(boxes[name], at[name])) for name, derivative in rates.derivatives(target).items()
    ]
    return reduce(total, steps, centre)


class Enclosure:
    """Plain intervals of a formula's or an expression's parts on some boxes, and of their derivatives; each once."""

    def __init__(self, boxes: Boxes, proven: Proven, with_derivatives: bool = False) -> None:
        self.boxes, self.proven, self.with_derivatives = boxes, proven, with_derivatives
        self._known: dict[AnyNode, tuple[Range, Derivatives]] = {}

    def range(self, node: AnyNode) -> Range:
        return self._of(node)[0]

    def derivatives(self, node: AnyNode) -> Derivatives:
        return self._of(node)[1]

    def _of(self, node: AnyNode) -> tuple[Range, Derivatives]:
        known = self._known.get(node)
        if known is None:
            args = [self._of(arg) for arg in _operands(node)]
            ranges, inner = [arg[0] for arg in args], [arg[1] for arg in args]
            own = self._range(node, ranges)
            value = self._clipped(node, own)
            known = value, (self._derivatives(node, ranges, inner, value) if self.with_derivatives else {})
            self._known[node] = known
        return known

    def _clipped(self, node: AnyNode, range_: Range) -> Range:
        if node not in self.proven:
            return range_
        least, most = self.proven[node]
        return np.clip(range_[0], least, most), np.clip(range_[1], least, most)

    def _range(self, node: AnyNode, args: list[Range]) -> Range:
        match node:
            case TrueFormula():
                return np.array(math.inf), np.array(math.inf)
            case Number(value):
                return np.array(value), np.array(value)
            case Signal(name):
                return self.boxes[name]
            case Predicate():
                large, small = args
                return total(large, negative(small))
            case Not() | Negative():
                return negative(args[0])
            case Connective():
                return OPERATIONS["min" if node.least else "max"].interval(_signed(node, args, negative))
            case Binary("*", left, right) if left == right:
                return power(args[0], 2)
            case Call(name) | Binary(name):
                return OPERATIONS[name].interval(args)
            case _:
                raise ValueError(f"expected a formula without temporal operators, got {node}")

    def _derivatives(self, node: AnyNode, args: list[Range], inner: list[Derivatives], value: Range) -> Derivatives:
        match node:
            case Signal(name):
                one = np.ones_like(self.boxes[name][0])
                return {name: (one, one)}
            case Predicate():
                return of_difference(args, inner, value)
            case Not() | Negative():
                return negated(inner[0])
            case Connective():
                rule = OPERATIONS["min" if node.least else "max"].derivative
                return rule(_signed(node, args, negative), _signed(node, inner, negated), value)
            case Call(name) | Binary(name):
                return OPERATIONS[name].derivative(args, inner, value)
            case _:
                return {}


def _operands(node: AnyNode) -> tuple[AnyNode, ...]:
    """The operands; of a predicate the greater side and the smaller side."""
    match node:
        case Predicate(op, left, right):
            return (right, left) if op in ("<=", "<") else (left, right)
        case _:
            return cast(tuple[AnyNode, ...], node.operands)


def _signed(node: Connective, parts: list[T], opposite: Callable[[T], T]) -> list[T]:
    """The bounds of the operands, or the opposite where the negation of an operand counts."""
    return [opposite(part) if sign else part for (_, sign), part in zip(node.signed, parts, strict=True)]


Floats: TypeAlias = NDArray[np.float64]
#: boxes split at once: enough to hide the interpreter, few enough to stay close to best-first order
BATCH = 64
#: interval operations that one extreme may take: a part of the formula and its derivative by each signal, on one box
WORK = 12_800_000


class Maximum(NamedTuple):
    """The maximum lies in [reached, bound]: `bound` is proven, `reached` is a value at a point, to rounding."""

    bound: float
    reached: float


@dataclass(frozen=True)
class Search:
    """A box, and the work that may be spent on its extremes."""

    ends: dict[str, tuple[float, float]]  # of each signal
    tolerance: float  # of an extreme, absolute
    boxes: int  # how many may be examined for one extreme; fewer where a box takes much work
    work: int = WORK  # how many interval operations one extreme may take
    proven: Proven = field(default_factory=dict)  # ranges of arguments that are known so far

    def extremes(self, target: Formula | Expression) -> tuple[Maximum, Maximum]:
        """The maximum of the negated margin (value) of `target`, and the maximum of the margin itself."""
        psi = target if isinstance(target, Formula) else Predicate(">=", target, Number(0.0))
        compiled = compile_arrays(psi, tuple(self.ends), "margin")

        def at(points: Floats) -> Floats:
            values = compiled(points) if callable(compiled) else compiled
            return np.broadcast_to(np.asarray(values), points.shape[:1])

        def enough(reached: float) -> float:
            return reached + self.tolerance

        lowest = self._maximum(target, True, lambda points: -at(points), enough, self.boxes)
        return lowest, self._maximum(target, False, at, enough, self.boxes)

    def falls_below(self, target: Expression, least: float, boxes: int) -> bool:
        """Whether some point of the box was found where `target` is provably less than `least`."""

        def at(points: Floats) -> Floats:
            ends = enclosure(target, self._named(points, points), self.proven)
            return np.broadcast_to(-ends[1], points.shape[:1])

        def enough(reached: float) -> float:
            return np.inf if reached > -least else -least

        return self._maximum(target, True, at, enough, boxes).reached > -least

    def _maximum(
        self,
        target: Formula | Expression,
        negated: bool,
        at: Callable[[Floats], Floats],
        enough: Callable[[float], float],
        boxes: int,
    ) -> Maximum:
        """Bound the maximum of (negated) `target`, which is `at` at points (m, n).

        A bound need not be below `enough` of the best value reached: boxes under it are not split.
        """

        def upper_ends(low: Floats, high: Floats) -> Floats:
            ends = enclosure(target, self._named(low, high), self.proven)
            upper = np.broadcast_to(-ends[0] if negated else ends[1], low.shape[:1])
            return np.where(np.isnan(upper), np.inf, upper)

        def best_point(low: Floats, high: Floats) -> float:
            points = np.concatenate([low / 2 + high / 2, low, high])
            return float(np.nanmax(at(points), initial=-np.inf))

        boxes = min(boxes, self.work // (target.size * (1 + len(self.ends))))
        box = np.array(list(self.ends.values()), dtype=float).reshape(-1, 2)
        low, high = box[None, :, 0], box[None, :, 1]
        widths = np.where(box[:, 1] > box[:, 0], box[:, 1] - box[:, 0], 1.0)
        upper, reached = upper_ends(low, high), best_point(low, high)
        dropped, examined = -np.inf, 1
        while len(upper) and upper.max() > enough(reached) and examined < boxes:
            best = np.argsort(-upper)[: max(BATCH, len(upper) // 4)]
            new_low, new_high = _split(low[best], high[best], widths)
            if not len(new_low):
                break
            new_upper = np.minimum(upper_ends(new_low, new_high), np.tile(upper[best], 2))
            reached = max(reached, best_point(new_low, new_high))
            low = np.concatenate([np.delete(low, best, axis=0), new_low])
            high = np.concatenate([np.delete(high, best, axis=0), new_high])
            upper = np.concatenate([np.delete(upper, best), new_upper])
            examined += len(new_upper)
            hopeless = upper <= enough(reached)
            dropped = max(dropped, upper[hopeless].max(initial=-np.inf))
            low, high, upper = low[~hopeless], high[~hopeless], upper[~hopeless]
        return Maximum(float(max(dropped, upper.max(initial=-np.inf))), reached)

    def _named(self, low: Floats, high: Floats) -> Boxes:
        return {name: (low[:, i], high[:, i]) for i, name in enumerate(self.ends)}


def _split(low: Floats, high: Floats, widths: Floats) -> tuple[Floats, Floats]:
    """Both halves of each box, cut across the side that is longest in units of the whole box."""
    if low.shape[1] == 0:
        return low[:0], high[:0]
    side = np.argmax((high - low) / widths, axis=1)
    rows = np.arange(len(low))
    middle = low[rows, side] / 2 + high[rows, side] / 2
    first_high, second_low = high.copy(), low.copy()
    first_high[rows, side] = middle
    second_low[rows, side] = middle
    return np.concatenate([low, second_low]), np.concatenate([first_high, high])


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
        TypeError: a masked array, or `names` is text.
        ValueError: psi has temporal operators, names are alike, or an end of the box is not finite or low > high.
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
    low, high = -lowest.bound, highest.bound
    errors = (0.0, 0.0) if low == high else (_error(lowest), _error(highest))  # equal also if infinite, as of True
    return Bounds(low, high, *errors, tolerance)


def _refuse_undefined(psi: Formula, ends: Mapping[str, tuple[float, float]]) -> None:
    names, box = tuple(ends), np.array(list(ends.values())).reshape(-1, 2)
    for point in (box.mean(axis=1), box[:, 0], box[:, 1]):
        if np.isnan(margin(psi, names)(point)):
            raise UndefinedError(cause(psi, names, point))


def _error(maximum: Maximum) -> float:
    if math.isinf(maximum.bound):  # a value that overflows reaches it in floats alone
        return math.inf
    return maximum.bound - maximum.reached if maximum.bound > maximum.reached else 0.0


def _ends(
    psi: Formula, box: Mapping[str, tuple[float, float]] | ArrayLike, names: Sequence[str] | None
) -> dict[str, tuple[float, float]]:
    if not isinstance(box, Mapping):
        if names is None:
            raise ValueError("an array of bounds needs the signals' names")
        names, rows = as_names(names, psi, "box"), np.asarray(as_array(box), dtype=float)
        if rows.shape != (len(names), 2):
            raise ValueError(f"bounds of {len(names)} signals have shape ({len(names)}, 2), got {rows.shape}")
        check_names(psi, names, "box")
        box = {name: (low, high) for name, (low, high) in zip(names, rows.tolist(), strict=True)}
    check_names(psi, as_names(tuple(box), psi, "box"), "box")
    ends = {name: _pair(name, box[name]) for name in signals(psi)}
    for name, (low, high) in ends.items():
        if not (np.isfinite(low) and np.isfinite(high) and low <= high):
            raise ValueError(f"bounds of {name!r} must be finite with low <= high, got [{low}, {high}]")
    return ends


def _pair(name: str, given: ArrayLike) -> tuple[float, float]:
    pair = as_array(given)
    if pair.shape != (2,):
        raise ValueError(f"bounds of {name!r} are two numbers, low and high, got {shorten(repr(given))}")
    return float(pair[0]), float(pair[1])


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
