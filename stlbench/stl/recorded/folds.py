"""Functions of many values that are like a minimum or a maximum: of all at once, or one value after the other.

Each is a sum, or a minimum, of something that is worked out for each value. So a few numbers say all of the values so
far that matters, however many they are: the summary, which grows by `merge`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import ClassVar, Self, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Fold(ABC):
    """A function of any number of values, none of them NaN. Summaries have shape (..., size)."""

    size: ClassVar[int] = 1
    """Numbers in a summary."""
    merge: ClassVar[np.ufunc] = np.add
    """What makes one summary of two."""
    empty: ClassVar[float] = 0.0
    """Each number of the summary of no value."""

    sign: int = 1
    """-1 for the maximum that belongs to the minimum: max(x) = -min(-x)."""

    def mirrored(self) -> Self:
        """The maximum that belongs to a minimum, and the other way round."""
        return replace(self, sign=-self.sign)

    def lift(self, values: Floats) -> Floats:
        """The summary of each value alone: (...) -> (..., size)."""
        return self._lift(self.sign * values)

    def read(self, summary: Floats) -> Floats:
        """The function of the values that were merged: (..., size) -> (...). Of none: inf, or -inf for a maximum."""
        return self.sign * self._read(summary)

    def repeat(self, summary: Floats, count: ArrayLike) -> Floats:
        """The summary of `count` (...) times the same values, 0 times allowed."""
        return summary * np.asarray(count, dtype=np.float64)[..., None]

    def __call__(self, values: Floats) -> Floats:
        """The function along the last axis: (..., n) -> (...)."""
        return self.read(self.merge.reduce(self.lift(values), axis=-2))

    @abstractmethod
    def _lift(self, values: Floats) -> Floats:
        """As `lift`, for the minimum."""

    @abstractmethod
    def _read(self, summary: Floats) -> Floats:
        """As `read`, for the minimum."""


@dataclass(frozen=True, kw_only=True)
class Least(Fold):
    """The minimum."""

    merge: ClassVar[np.ufunc] = np.minimum
    empty: ClassVar[float] = math.inf

    def repeat(self, summary: Floats, count: ArrayLike) -> Floats:
        """The same, if once or more."""
        return np.where(np.asarray(count)[..., None] > 0, summary, math.inf)

    def _lift(self, values: Floats) -> Floats:
        return values[..., None]

    def _read(self, summary: Floats) -> Floats:
        least: Floats = summary[..., 0]
        return least


@dataclass(frozen=True, kw_only=True)
class SoftLeast(Fold):
    """-log(sum exp(-b x)) / b: at most the minimum, and for n values less by log(n) / b at most."""

    sharpness: float

    def _lift(self, values: Floats) -> Floats:
        return np.asarray(np.exp(-self.sharpness * values)[..., None])

    def _read(self, summary: Floats) -> Floats:
        with np.errstate(divide="ignore"):
            return np.asarray(-np.log(summary[..., 0]) / self.sharpness)


class _Counted(Fold):
    """A fold whose summary ends with how many values there are."""

    def _read(self, summary: Floats) -> Floats:
        count = summary[..., -1]
        return np.where(count > 0, self._of(summary, np.maximum(count, 1.0)), math.inf)

    @abstractmethod
    def _of(self, summary: Floats, count: Floats) -> Floats:
        """The function of `count` >= 1 values."""


@dataclass(frozen=True, kw_only=True)
class GeometricLeast(_Counted):
    """Where some value is at most 0 the mean of min(x, 0); else the geometric mean of 1 + x, less 1."""

    size: ClassVar[int] = 4

    def _lift(self, values: Floats) -> Floats:
        above = np.log1p(np.maximum(values, 0.0))
        return np.stack([np.minimum(values, 0.0), above, values <= 0, np.ones_like(values)], axis=-1)

    def _of(self, summary: Floats, count: Floats) -> Floats:
        return np.where(summary[..., 2] > 0, summary[..., 0] / count, np.expm1(summary[..., 1] / count))


@dataclass(frozen=True, kw_only=True)
class RootLeast(_Counted):
    """sqrt(M0) - sqrt(Mp), M0 = (eps^n + prod max(x, 0)^2)^(1/n), Mp = (eps^p + mean max(-x, 0)^(2p))^(1/p)."""

    size: ClassVar[int] = 4
    eps: float = 1e-8
    p: int = 1

    def _lift(self, values: Floats) -> Floats:
        squares = 2 * np.log(np.where(values > 0, values, 1.0))
        below = np.maximum(-values, 0.0) ** (2 * self.p)
        return np.stack([below, squares, values <= 0, np.ones_like(values)], axis=-1)

    def _of(self, summary: Floats, count: Floats) -> Floats:
        product = np.where(summary[..., 2] > 0, -math.inf, summary[..., 1])
        above = np.logaddexp(count * math.log(self.eps), product) / count
        below = (self.eps**self.p + summary[..., 0] / count) ** (1 / self.p)
        return np.asarray(np.exp(above / 2) - np.sqrt(below))


@dataclass(frozen=True, kw_only=True)
class Mean(_Counted):
    """The mean, which lies between the two."""

    size: ClassVar[int] = 2

    def _lift(self, values: Floats) -> Floats:
        return np.stack([values, np.ones_like(values)], axis=-1)

    def _of(self, summary: Floats, count: Floats) -> Floats:
        return np.asarray(summary[..., 0] / count)


@dataclass(frozen=True, kw_only=True)
class Total(Fold):
    """The sum."""

    def _lift(self, values: Floats) -> Floats:
        return values[..., None]

    def _read(self, summary: Floats) -> Floats:
        total: Floats = summary[..., 0]
        return total
