"""The flags of the flag method: how they count, and what is paid for them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract import Array, Integers, Specification

__all__ = ["AbsoluteFlags", "Flags", "WindowFlags", "is_windowed"]

Truth = NDArray[np.bool_]
Window = stl.Always | stl.Eventually


class Flags(ABC):
    """A set of m flags: their values before the first sample and when full, (m,) each; update; reward."""

    form: str
    initial: Array
    full: Array
    scale: float = 1.0

    @abstractmethod
    def update(self, signals: Array, t: Integers, flags: Array) -> Array:
        """The flags (N, m) after the sample `signals` (N, k) at steps t (N,)."""

    @abstractmethod
    def reward(self, flags: Array, t: Integers) -> Array:
        """What is paid (N,) for flags that include the sample at t."""


class WindowFlags(Flags):
    """(F|G)[0,Te] phi, phi an and/or of F[0,w] psi and G[0,w] psi, as in the source."""

    form = "outer operator over windows"

    def __init__(self, formula: stl.Formula, specification: Specification, beta: float) -> None:
        assert isinstance(formula, Window)
        self._outer_f, self._beta, self._phi = isinstance(formula, stl.Eventually), beta, formula.arg
        self._windows = list(_leaves(formula.arg))
        self._holds = [specification.holds(window.arg) for window in self._windows]
        self.full = np.array([window.b + 1.0 for window in self._windows])
        self.initial = np.zeros_like(self.full)

    def update(self, signals: Array, t: Integers, flags: Array) -> Array:
        """Each counter one sample on."""
        after = np.empty_like(flags)
        for i, (window, holds) in enumerate(zip(self._windows, self._holds, strict=True)):
            count = _count_eventually if isinstance(window, stl.Eventually) else _count_always
            after[:, i] = count(flags[:, i], holds(signals), self.full[i])
        return after

    def reward(self, flags: Array, t: Integers) -> Array:
        """F[0,w] is satisfied iff its counter is positive, G[0,w] iff its counter is full."""
        verdicts = iter(
            flags[:, i] > 0 if isinstance(window, stl.Eventually) else flags[:, i] == self.full[i]
            for i, window in enumerate(self._windows)
        )
        return _paid(_combined(self._phi, verdicts).astype(np.float64), self._outer_f, self._beta)


class AbsoluteFlags(Flags):
    """A conjunction of terms with absolute intervals: the extension to eq. 2."""

    form = "absolute intervals (extension)"

    def __init__(self, specification: Specification, beta: float) -> None:
        self._beta, self._terms = beta, specification.terms
        initial, full, self._columns = list[float](), list[float](), list[int]()
        for term in self._terms:
            self._columns.append(len(full))
            initial += {"F": [0.0], "G": [1.0], "FG": [0.0, 0.0]}[term.kind]
            full += [1.0, term.b - term.c2 + 1.0] if term.kind == "FG" else [1.0]
        self._holds = [specification.holds(term.psi) for term in self._terms]
        self._outer_f = np.array([term.kind != "G" for term in self._terms])
        self.initial, self.full = np.array(initial), np.array(full)
        t = np.arange(specification.steps + 1)
        self._active = np.stack([(term.start <= t) & (t <= term.end) for term in self._terms], axis=1)
        self.scale = float(self._active.sum(axis=1).max())

    def update(self, signals: Array, t: Integers, flags: Array) -> Array:
        """Latch F, drop G, count and latch F G, each on its own interval alone."""
        after, active = flags.copy(), self._active[t]
        for i, (term, holds, at) in enumerate(zip(self._terms, self._holds, self._columns, strict=True)):
            now, true = active[:, i], holds(signals)
            if term.kind == "G":
                after[now & ~true, at] = 0
            elif term.kind == "F":
                after[now & true, at] = 1
            else:
                after[:, at + 1] = np.where(now, _count_always(flags[:, at + 1], true, self.full[at + 1]), 0)
                after[after[:, at + 1] == self.full[at + 1], at] = 1
        return after

    def reward(self, flags: Array, t: Integers) -> Array:
        """The sum over the terms on whose interval t lies."""
        paid = np.where(self._active[t], _paid(flags[:, self._columns], self._outer_f, self._beta), 0)
        return np.asarray(paid.sum(axis=1))


def is_windowed(formula: stl.Formula) -> bool:
    """Whether a formula reads (F|G)[0,Te] phi with phi an and/or of F[0,w] psi and G[0,w] psi."""
    if not (isinstance(formula, Window) and formula.a == 0):
        return False
    return all(
        isinstance(leaf, Window) and leaf.a == 0 and not stl.is_temporal(leaf.arg) for leaf in _leaves(formula.arg)
    )


def _leaves(phi: stl.Formula) -> Iterator[Window]:
    """What is left of a formula without its and, or, in order of appearance; windows where `is_windowed`."""
    if isinstance(phi, stl.And | stl.Or):
        for arg in phi.args:
            yield from _leaves(arg)
    else:
        yield phi  # type: ignore[misc]  # checked by is_windowed


def _combined(phi: stl.Formula, verdicts: Iterator[Truth]) -> Truth:
    """The and/or of the leaves' verdicts, given in order of appearance."""
    if not isinstance(phi, stl.And | stl.Or):
        return next(verdicts)
    combine = np.logical_and if isinstance(phi, stl.And) else np.logical_or
    return reduce(combine, [_combined(arg, verdicts) for arg in phi.args])


def _count_eventually(flag: Array, holds: Truth, full: float) -> Array:
    """Full at a sample where psi holds, one less at each other: positive iff psi held among the last `full`."""
    return np.where(holds, full, np.maximum(flag - 1, 0))


def _count_always(flag: Array, holds: Truth, full: float) -> Array:
    """One more at each sample where psi holds, 0 at any other: full iff psi held at each of the last `full`."""
    return np.where(holds, np.minimum(flag + 1, full), 0)


def _paid(sat: Array, outer_f: bool | Truth, beta: float) -> Array:
    """exp(beta (sat - 1)) for F, -exp(-beta sat) for G."""
    return np.where(outer_f, np.exp(beta * (sat - 1)), -np.exp(-beta * sat))
