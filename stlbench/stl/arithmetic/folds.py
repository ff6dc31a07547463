"""Quantitative semantics: functions that are like a minimum or a maximum, of all values at once, one by one, or of
sliding windows.

A few numbers hold all that matters of the values so far, however many they are: the summary. It grows by `merge`. Most
summaries are sums, or minima, of a function of each value.

A sliding window of width w is covered by two windows of width 2^j <= w, which may overlap because min and max do not
count. Rows are worked on laid end to end, several times faster than row by row; what crosses a row's end is left out at
last. Windows work on float (robustness) and bool (Boolean semantics: minimum is and, maximum is or) arrays alike.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from typing import Any, ClassVar, Literal, Self, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.arithmetic import SMALLEST

Values = NDArray[Any]


def slide(values: Values, width: int, pick: np.ufunc) -> Values:
    """`pick` (np.minimum or np.maximum) over every window of `width` samples.

    values (..., m) with m >= width >= 1 -> (..., m - width + 1).
    """
    count = values.shape[-1] - width + 1
    if count == 1:
        return pick.reduce(values, axis=-1, keepdims=True)  # type: ignore[no-any-return]
    flat, size = values.reshape(-1), 1
    while 2 * size <= width:
        flat = pick(flat[:-size], flat[size:])
        size *= 2
    if size < width:
        flat = pick(flat[: size - width], flat[width - size :])
    return _rows(flat, values.shape, count)


def until(left: Values, right: Values, a: int, count: int) -> Values:
    """`left U[a,b] right` at `count` steps t: max over t' in [t+a, t+b] of min(right(t'), min of left on [t, t')).

    left (..., count + b - 1) begins at step 0, and is not read if b = 0; right (..., count + b - a) begins at step a.
    Split at a, exactly: left holds on [t, t+a), and from t + a on an until with the interval [0, b - a].
    """
    width = right.shape[-1] - count + 1
    if count == 1:
        return _first_until(left, right, a)
    result = _prompt_until(left[..., a:], right, width)
    if a > 0:
        result = np.minimum(result, slide(left[..., : count + a - 1], a, np.minimum))
    return result


def _prompt_until(left: Values, right: Values, width: int) -> Values:
    """Until with the interval [0, width - 1], by doubling; rows of left may be one sample shorter than those of right.

    With U over [t, t+s) and L the minimum of left over the same steps, U over [t, t+2s) is max(U, min(L, U(t+s))). An
    overlap in the last round is harmless: it repeats candidates with more of left in their minimum.
    """
    guard = np.empty_like(right)
    guard[..., :-1], guard[..., -1] = left[..., : right.shape[-1] - 1], right[..., -1]  # the last is not read
    low, best, size = guard.reshape(-1), right.reshape(-1), 1
    while size < width:
        step = min(size, width - size)
        later = np.minimum(low[:-step], best[step:])
        best = np.maximum(best[:-step], later, out=later)
        low = np.minimum(low[:-step], low[step:])
        size += step
    return _rows(best, right.shape, right.shape[-1] - width + 1)


def _rows(flat: Values, shape: tuple[int, ...], count: int) -> Values:
    """The first `count` of each row of an array of `shape` whose rows `flat` has one after the other, as a view."""
    item = flat.itemsize
    strides = [item * math.prod(shape[axis + 1 :]) for axis in range(len(shape))]
    return np.ndarray((*shape[:-1], count), flat.dtype, np.ascontiguousarray(flat), strides=strides)


def _first_until(left: Values, right: Values, a: int) -> Values:
    """Until at one step: one running minimum of left, which is then compared with right one step later."""
    b = a + right.shape[-1] - 1
    if b == 0:
        return right
    before = np.minimum.accumulate(left[..., :b], axis=-1)
    if a > 0:
        return np.minimum(right, before[..., a - 1 :]).max(axis=-1, keepdims=True)  # type: ignore[no-any-return]
    later = np.minimum(right[..., 1:], before).max(axis=-1, keepdims=True)
    first: Values = np.maximum(right[..., :1], later)
    return first


Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Fold:
    """A function of any number of values, none of them NaN. Summaries have shape (..., size)."""

    size: ClassVar[int] = 1  # numbers in a summary
    joins: ClassVar[np.ufunc] = np.add  # makes one summary of two, number by number
    empty: ClassVar[float] = 0.0  # each number of the summary of no value
    sign: int = 1  # -1 for the maximum that belongs to the minimum: max(x) = -min(-x)

    def mirrored(self) -> Self:
        """The maximum that belongs to a minimum, and the other way round."""
        return replace(self, sign=-self.sign)

    def lift(self, values: Floats) -> Floats:
        """The summary of each value alone: (...) -> (..., size)."""
        return self._lift(self.sign * values)

    def read(self, summary: Floats) -> Floats:
        """The function of the values that were merged: (..., size) -> (...). For none: inf, or -inf for a maximum."""
        return self.sign * self._read(summary)

    def repeat(self, summary: Floats, count: ArrayLike) -> Floats:
        """The summary of `count` (...) times the same values, 0 times allowed."""
        with np.errstate(divide="ignore", invalid="ignore"):
            repeated = self._repeated(summary, np.asarray(count, dtype=np.float64)[..., None])
        return np.where(np.isnan(repeated), self.empty, repeated)  # 0 times infinity

    def _repeated(self, summary: Floats, times: Floats) -> Floats:
        return summary * times

    def __call__(self, values: Floats) -> Floats:
        """The function along the last axis: (..., n) -> (...)."""
        return self.read(self.merged(self.lift(values)))

    def of(self, parts: Sequence[Floats]) -> Floats:
        """The function of n arrays, element by element: (...) each -> (...)."""
        return self(np.stack(parts, axis=-1))

    def merge(self, left: Floats, right: Floats) -> Floats:
        """One summary of two: (..., size), (..., size) -> (..., size)."""
        return np.asarray(self.joins(left, right))

    def merged(self, summaries: Floats) -> Floats:
        """One summary of n: (..., n, size) -> (..., size)."""
        return np.asarray(self.joins.reduce(summaries, axis=-2))

    def accumulated(self, summaries: Floats) -> Floats:
        """The summaries of the first 1, 2, ..., n: (..., n, size) -> (..., n, size)."""
        return np.asarray(self.joins.accumulate(summaries, axis=-2))

    def sliding(self, summaries: Floats, width: int) -> Floats:
        """The summary of every `width` in a row: (n, m, size) -> (n, m - width + 1, size)."""
        return self.merged(sliding_window_view(summaries, width, axis=1).swapaxes(-1, -2))

    def _lift(self, values: Floats) -> Floats:  # of the minimum
        return values[..., None]

    def _read(self, summary: Floats) -> Floats:  # of the minimum
        return np.asarray(summary[..., 0])


@dataclass(frozen=True, kw_only=True)
class Least(Fold):
    """The minimum."""

    joins: ClassVar[np.ufunc] = np.minimum
    empty: ClassVar[float] = math.inf

    def repeat(self, summary: Floats, count: ArrayLike) -> Floats:
        return np.where(np.asarray(count)[..., None] > 0, summary, math.inf)

    def of(self, parts: Sequence[Floats]) -> Floats:
        return reduce(np.minimum if self.sign > 0 else np.maximum, parts)

    def sliding(self, summaries: Floats, width: int) -> Floats:
        return slide(summaries[..., 0], width, np.minimum)[..., None]


@dataclass(frozen=True, kw_only=True)
class SoftLeast(Fold):
    """-log(sum exp(-b x)) / b: from min(x) - log(n) / b to min(x), for n values and to rounding.

    It is above 0 only where all values are, also in floats. The summary is the logarithm of the sum: no exponential
    overflows.
    """

    joins: ClassVar[np.ufunc] = np.logaddexp
    empty: ClassVar[float] = -math.inf

    sharpness: float

    def _repeated(self, summary: Floats, times: Floats) -> Floats:
        return summary + np.log(times)

    def _lift(self, values: Floats) -> Floats:
        return np.asarray(-self.sharpness * values)[..., None]

    def _read(self, summary: Floats) -> Floats:
        return np.asarray(-summary[..., 0] / self.sharpness)


@dataclass(frozen=True, kw_only=True)
class WeightedLeast(Fold):
    """sum x exp(-b x) / sum exp(-b x): from min(x) to min(x) + log(n) / b, for n values and to rounding.

    The summary has the minimum m, the sum of w (x - m) and the sum of w, with w = exp(-b (x - m)), which does not
    overflow. So the value is at least m in floats too.
    """

    size: ClassVar[int] = 3
    empty: ClassVar[float] = math.inf

    sharpness: float

    def merge(self, left: Floats, right: Floats) -> Floats:
        return self.merged(np.stack(np.broadcast_arrays(left, right), axis=-2))

    def merged(self, summaries: Floats) -> Floats:
        lows, rises, weights = np.moveaxis(summaries, -1, 0)
        least = lows.min(axis=-1, keepdims=True)
        with np.errstate(invalid="ignore"):
            shifts = np.where(lows == least, 0.0, lows - least)  # 0 also where both are the same infinity
            share = np.exp(-self.sharpness * shifts)
            terms = [np.where(share > 0, share * each, 0.0) for each in (rises + weights * shifts, weights)]
        return np.stack([least[..., 0], *(term.sum(axis=-1) for term in terms)], axis=-1)

    def accumulated(self, summaries: Floats) -> Floats:
        merged = [summaries[..., 0, :]]
        for i in range(1, summaries.shape[-2]):
            merged.append(self.merge(merged[-1], summaries[..., i, :]))
        return np.stack(merged, axis=-2)

    def repeat(self, summary: Floats, count: ArrayLike) -> Floats:
        times = np.asarray(count, dtype=np.float64)[..., None] * np.array([0.0, 1.0, 1.0])
        times[..., 0] = times[..., 1] > 0  # the minimum stays
        with np.errstate(invalid="ignore"):
            return np.asarray(np.where(times > 0, summary * times, math.inf))

    def _lift(self, values: Floats) -> Floats:
        return np.stack([values, np.zeros_like(values), np.ones_like(values)], axis=-1)

    def _read(self, summary: Floats) -> Floats:
        low, rise, weight = np.moveaxis(summary, -1, 0)
        finite = np.isfinite(low)
        mean: Floats = np.where(finite, low + np.where(finite, rise, 0.0) / np.where(finite, weight, 1.0), low)
        return mean


class _Counted(Fold):
    """A fold whose summary ends with how many values there are."""

    def _read(self, summary: Floats) -> Floats:
        count = summary[..., -1]
        return np.where(count > 0, self._of(summary, np.maximum(count, 1.0)), math.inf)

    def _of(self, summary: Floats, count: Floats) -> Floats:  # of `count` >= 1 values
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class GeometricLeast(_Counted):
    """Where some value is at most 0 the mean of min(x, 0); else the geometric mean of 1 + x, less 1."""

    size: ClassVar[int] = 4

    def _lift(self, values: Floats) -> Floats:
        above = np.log1p(np.maximum(values, 0.0))
        return np.stack([np.minimum(values, 0.0), above, values <= 0, np.ones_like(values)], axis=-1)

    def _of(self, summary: Floats, count: Floats) -> Floats:
        below = np.minimum(summary[..., 0] / count, np.where(summary[..., 0] < 0, -SMALLEST, 0.0))
        above = np.maximum(np.expm1(summary[..., 1] / count), SMALLEST)
        return np.where(summary[..., 2] > 0, below, above)


@dataclass(frozen=True, kw_only=True)
class RootLeast(_Counted):
    """sqrt(M0) - sqrt(Mp), M0 = (eps^n + prod max(x, 0)^2)^(1/n), Mp = (eps^p + mean max(-x, 0)^(2p))^(1/p).

    One of the two roots is always sqrt(eps). The difference of the other from it is computed without a subtraction,
    whose rounding could turn the sign. Floors keep the difference from 0, where a product or a square would be.
    """

    size: ClassVar[int] = 4
    eps: float = 1e-8
    p: int = 1

    def _lift(self, values: Floats) -> Floats:
        squares = 2 * np.log(np.where(values > 0, values, 1.0))
        below = np.where(values < 0, np.maximum(np.abs(values) ** (2 * self.p), 1e-290), 0.0)
        return np.stack([below, squares, values <= 0, np.ones_like(values)], axis=-1)

    def _of(self, summary: Floats, count: Floats) -> Floats:
        product = np.maximum(summary[..., 1] - count * math.log(self.eps), -600.0)  # in units of eps^n, its logarithm
        above = np.expm1(np.logaddexp(0.0, product) / (2 * count))
        below = -np.expm1(np.log1p(summary[..., 0] / count / self.eps**self.p) / (2 * self.p))
        return np.asarray(math.sqrt(self.eps) * np.where(summary[..., 2] > 0, below, above))


@dataclass(frozen=True, kw_only=True)
class Mean(_Counted):
    """The mean."""

    size: ClassVar[int] = 2

    def _lift(self, values: Floats) -> Floats:
        return np.stack([values, np.ones_like(values)], axis=-1)

    def _of(self, summary: Floats, count: Floats) -> Floats:
        return np.asarray(summary[..., 0] / count)


@dataclass(frozen=True, kw_only=True)
class Total(Fold):
    """The sum."""


#: the semantics that there are, see `semantics`
SemanticsName: TypeAlias = Literal["classic", "lse", "gilpin", "agm", "gmsr"]


@dataclass(frozen=True)
class Semantics:
    """A minimum-like and a maximum-like function."""

    least: Fold
    """For `&` and G."""
    greatest: Fold
    """For `|`."""
    eventually: Fold
    """For F, and the choice of the step in an until."""
    divided: bool
    """Whether it is made for predicates of about [-1, 1]: each predicate is a leaf of its own then."""


def semantics(name: SemanticsName, sharpness: float = 10.0) -> Semantics:
    """One of the published semantics.

    Args:
        name: `classic`, minimum and maximum; `lse`, log-sum-exp for both (Pant, Abbas, Mangharam, CCTA 2017); `gilpin`,
            log-sum-exp for the minimum and a weighted mean for the maximum (Gilpin, Kurtz, Lin, L-CSS 2020); `agm`,
            arithmetic-geometric mean (Mehdipour, Vasile, Belta 2019); `gmsr`, generalised mean (Uzun, Elango, Garoche,
            Acikmese, arXiv 2405.10996), with its eps = 1e-8 and p = 1.
        sharpness: b of `lse` and `gilpin`, > 0, finite. For n values, the minimum of both is up to log(n) / b too low.
            The maximum of `lse` is up to log(n) / b too high: its sign can be wrong either way. That of `gilpin` is up
            to log(n) / b too low, so its value is never above the robustness: positive means satisfied.
    """
    if not 0 < sharpness < math.inf:
        raise ValueError(
            f"the sharpness is a finite number above 0, got {sharpness}; the limit at infinity is 'classic'"
        )
    soft, weighted = SoftLeast(sharpness=sharpness), WeightedLeast(sharpness=sharpness)
    folds: dict[str, tuple[Fold, Fold]] = {
        "classic": (Least(), Least()),
        "lse": (soft, soft),
        "gilpin": (soft, weighted),
        "agm": (GeometricLeast(), GeometricLeast()),
        "gmsr": (RootLeast(), RootLeast()),
    }
    if name not in folds:
        raise ValueError(f"there are the semantics {', '.join(folds)}, not {name!r}")
    least, greatest = folds[name][0], folds[name][1].mirrored()
    return Semantics(least, greatest, greatest, divided=name != "classic")
