"""The flags of the flag method: how they count, and what is paid for them."""

from __future__ import annotations

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from operator import itemgetter
from typing import NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Specification, Truth

__all__ = ["FG", "AbsoluteFlags", "F", "Flags", "G", "Terms", "WindowFlags", "is_windowed"]

Window = stl.Always | stl.Eventually
F, G, FG = 0, 1, 2
"""Kinds of terms, for compiled code."""
_KINDS = {"F": F, "G": G, "FG": FG}


class Terms(NamedTuple):
    """The n terms of a conjunction, for compiled code."""

    kinds: Integers
    """(n,): `F`, `G` or `FG`."""
    columns: Integers
    """(n,): where a term's flag is; the counter of F G follows it."""
    active: Truth
    """(n, T + 1): the samples of its interval."""
    paid: Array
    """(n, 2): for the flag down and up."""


class Flags(ABC):
    """A set of m flags: their values before the first sample and when full, (m,) each; how they go on."""

    form: str
    initial: Array
    full: Array
    scale: float = 1.0

    @abstractmethod
    def along(self, samples: Array, t: Integers, flags: Array) -> tuple[Array, Array]:
        """Take h samples (h, N, k), the first at steps t (N,), one after the other, from flags (N, m).

        Returns what is paid at each sample (h, N), for flags that include it, and the flags after the last (N, m).
        """


class WindowFlags(Flags):
    """(F|G)[0,Te] phi, phi an and/or of F[0,w] psi and G[0,w] psi, as in the source."""

    form = "outer operator over windows"

    def __init__(self, formula: stl.Formula, specification: Specification, beta: float) -> None:
        assert isinstance(formula, Window)
        windows = list(_leaves(formula.arg))
        self._holds = [specification.holds(window.arg) for window in windows]
        self._eventually = np.array([isinstance(window, stl.Eventually) for window in windows])
        self._combined = _combined(formula.arg, itertools.count())
        self._paid = _paid(isinstance(formula, stl.Eventually), beta)
        self.full = np.array([window.b + 1.0 for window in windows])
        self.initial = np.zeros_like(self.full)

    def along(self, samples: Array, t: Integers, flags: Array) -> tuple[Array, Array]:
        """F[0,w] is satisfied iff its counter is positive, G[0,w] iff its counter is full."""
        from stlbench_methods.flag_updates import count  # imports Numba, which building a method does without

        after = flags.copy()
        verdicts = _truths(self._holds, samples)
        count(verdicts, self._eventually, self.full, after)
        return self._paid[self._combined(verdicts).view(np.int8)], after


class AbsoluteFlags(Flags):
    """A conjunction of terms with absolute intervals: the extension to eq. 2."""

    form = "absolute intervals (extension)"

    def __init__(self, specification: Specification, beta: float) -> None:
        terms = specification.terms
        initial, full, columns = list[float](), list[float](), list[int]()
        for term in terms:
            columns.append(len(full))
            initial += {"F": [0.0], "G": [1.0], "FG": [0.0, 0.0]}[term.kind]
            full += [1.0, term.b - term.c2 + 1.0] if term.kind == "FG" else [1.0]
        self._holds = [specification.holds(term.psi) for term in terms]
        t = np.arange(specification.steps + 1)
        active = np.array([(term.start <= t) & (t <= term.end) for term in terms])
        self._terms = Terms(
            np.array([_KINDS[term.kind] for term in terms]),
            np.array(columns),
            active,
            np.array([_paid(term.kind != "G", beta) for term in terms]),
        )
        self.initial, self.full = np.array(initial), np.array(full)
        self.scale = float(active.sum(axis=0).max())

    def along(self, samples: Array, t: Integers, flags: Array) -> tuple[Array, Array]:
        """Latch F, drop G, count and latch F G, each on its own interval alone; pay the sum of those on whose it is."""
        from stlbench_methods.flag_updates import latch  # as above

        after = flags.copy()
        return latch(_truths(self._holds, samples), self._terms, self.full, t, after), after


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


def _combined(phi: stl.Formula, leaf: Iterator[int]) -> Callable[[Truth], Truth]:
    """The and/or as a function of its leaves' verdicts (m, ...), in order of appearance; `leaf` counts them."""
    if not isinstance(phi, stl.And | stl.Or):
        return itemgetter(next(leaf))
    combine = np.logical_and if isinstance(phi, stl.And) else np.logical_or
    parts = [_combined(arg, leaf) for arg in phi.args]
    return lambda verdicts: reduce(combine, [part(verdicts) for part in parts])


def _truths(predicates: Sequence[Callable[[Array], Truth]], samples: Array) -> Truth:
    """Which predicates hold at the samples (h, N, k): (number of predicates, h, N)."""
    truths = np.empty((len(predicates), *samples.shape[:2]), dtype=np.bool_)
    for i, holds in enumerate(predicates):
        truths[i] = holds(samples)
    return truths


def _paid(outer_f: bool, beta: float) -> Array:
    """What is paid for sat = 0 and for sat = 1: exp(beta (sat - 1)) for F, -exp(-beta sat) for G."""
    return np.array([math.exp(-beta), 1.0] if outer_f else [-1.0, -math.exp(-beta)])
