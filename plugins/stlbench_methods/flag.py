"""flag: F-MDP, one flag per term instead of a history (Venkataraman, Aksaray, Seiler, L4DC 2020)."""

import itertools
import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from functools import reduce
from operator import itemgetter
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification, Truth
from stlbench_methods.formula_parts import EXTENSION, KINDS, Terms, Window, from_first_read, leaves, truths


class Flag(RewardMethod):
    """One flag per term, updated from the predicate alone; the reward is for the truth of the flags.

    The task (or its nested form) may read (F|G)[0,Te] phi, with phi an and/or of F[0,w] psi and G[0,w] psi. Its flags
    are integer counters over windows of w + 1 samples, and sat is the and/or of their verdicts. An outer F pays
    exp(beta (sat - 1)), an outer G -exp(-beta sat). Both are in [-1, 1]: exp(beta sat) is scaled by exp(-beta). Windows
    may all begin at the same later step, as in G[0,Te] G[300,310] psi: an extension, as the source has them from 0.

    Any other formula of the fragment of eq. 2 has no outer operator and absolute intervals, which that method does
    not treat. The extension: F[a,b] psi has a flag latched once psi held in [a,b]; the flag of G[a,b] psi is 1 until
    psi fails in [a,b]; F[a,c1] G[c2,b] psi counts samples of psi and latches at a full window. Each is paid as above,
    F or G, on its own interval; intervals that overlap pay the sum.

    Args:
        beta: 50 in the sources; the reward is then about 0 or 1 in size.

    Raises:
        Unsuitable: the formula has neither form.
    """

    preference = MappingProxyType({"recurring": 1})

    def __init__(self, specification: Specification, *, beta: Annotated[float, Field(gt=0)] = 50.0) -> None:
        super().__init__(specification)
        nested = specification.formula if specification.nested is None else specification.nested
        windowed = is_windowed(nested)
        self._flags: Flags = (
            WindowFlags(nested, specification, beta) if windowed else AbsoluteFlags(specification, beta)
        )
        self.memory_size, self.scale = self._flags.size, self._flags.scale
        self.extension, self.floor = self._flags.extension, self._flags.floor

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        """The flags after the first sample, (N, m); they were 0 before it (1 for the absolute G), whenever it is."""
        return self._flags.begin(signals, t)

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        return self._flags.along(samples[1:], t + 1, memory)

    def inputs(self, memory: Array) -> Array:
        return self._flags.inputs(memory)

    def describe(self) -> Mapping[str, Any]:
        return {"form": self._flags.form, "flags": [int(value) for value in self._flags.full]}


class Flags(ABC):
    """A set of m flags: their values before the first sample and when full, (m,) each, and their updates."""

    form: str
    initial: Array
    full: Array
    floor: float  # the least that can be paid at a sample
    scale: float = 1.0
    extension: str = ""

    @property
    def size(self) -> int:
        return len(self.full)

    def inputs(self, memory: Array) -> Array:
        return memory / self.full

    def begin(self, signals: Array, t: Integers) -> Array:
        """The flags after a first sample (N, k), (N, m)."""
        return self.along(signals[None], t, np.tile(self.initial, (len(signals), 1)))[1]

    @abstractmethod
    def along(self, samples: Array, t: Integers, flags: Array) -> tuple[Array, Array]:
        """Take samples (h, N, k), the first at t (N,), from flags (N, m): the pay (h, N), and the flags after."""


class WindowFlags(Flags):
    """(F|G)[0,Te] phi, phi an and/or of F[0,w] psi and G[0,w] psi, as in the source.

    If all windows of phi begin at a later step, nothing is counted and 0 is paid before it: that sample is then to
    them what the first is to the source's.
    """

    form = "outer operator over windows"

    def __init__(self, formula: stl.Formula, specification: Specification, beta: float) -> None:
        assert isinstance(formula, Window)
        self._first, phi = from_first_read(formula.arg)
        windows = list(_windows(phi))
        self._holds = [specification.holds(window.arg) for window in windows]
        self._eventually = np.array([isinstance(window, stl.Eventually) for window in windows])
        self._combined = _combined(phi, itertools.count())
        self._paid = _paid(isinstance(formula, stl.Eventually), beta)
        self.floor = float(self._paid[0])
        if self._first:
            self.form = "outer operator over windows that begin late (extension)"
            self.extension = f"windows begin {self._first} steps late; its source has them from 0"
            self.floor = min(0.0, self.floor)
        self.full = np.array([window.b + 1.0 for window in windows])
        self.initial = np.zeros_like(self.full)

    def along(self, samples: Array, t: Integers, flags: Array) -> tuple[Array, Array]:
        """F[0,w] is satisfied iff its counter is positive, G[0,w] iff its counter is full."""
        from stlbench_methods.updates import count  # imports Numba, which building a method does without

        after = flags.copy()
        verdicts = truths(self._holds, samples)
        if self._first:
            begun = t + np.arange(len(samples))[:, None] >= self._first
            verdicts &= begun
        count(verdicts, self._eventually, self.full, after)
        paid = self._paid[self._combined(verdicts).view(np.int8)]  # False and True are the places 0 and 1
        return np.where(begun, paid, 0.0) if self._first else paid, after


class AbsoluteFlags(Flags):
    form = "absolute intervals (extension)"
    extension = EXTENSION

    def __init__(self, specification: Specification, beta: float) -> None:
        terms = specification.terms
        initial, full, columns = list[float](), list[float](), list[int]()
        for term in terms:
            columns.append(len(full))
            initial += {"F": [0.0], "G": [1.0], "FG": [0.0, 0.0]}[term.kind]
            full += [1.0, float(term.length)] if term.kind == "FG" else [1.0]
        self.columns = np.array(columns)
        """(n,): the place of each term's flag, which is 1 if the term is satisfied once its interval is over."""
        self._holds = [specification.holds(term.psi) for term in terms]
        t = np.arange(specification.steps + 1)
        active = np.array([(term.start <= t) & (t <= term.end) for term in terms])
        self._terms = Terms(
            np.array([KINDS[term.kind] for term in terms]),
            self.columns,
            active,
            np.array([_paid(term.kind != "G", beta) for term in terms]),
        )
        # Sample 0 is never paid for; a flag that is down pays the least.
        self.floor = float((active[:, 1:] * self._terms.paid[:, :1]).sum(axis=0).min())
        self.initial, self.full = np.array(initial), np.array(full)
        self.scale = float(active.sum(axis=0).max())

    def along(self, samples: Array, t: Integers, flags: Array) -> tuple[Array, Array]:
        """Latch F, drop G, count and latch F G, each on its own interval alone; pay the sum over those intervals."""
        from stlbench_methods.updates import latch  # as above

        after = flags.copy()
        return latch(truths(self._holds, samples), self._terms, self.full, t, after), after


def is_windowed(formula: stl.Formula) -> bool:
    """Whether a formula reads (F|G)[0,Te] phi with phi an and/or of F[a,a+w] psi and G[a,a+w] psi, all of one a."""
    if not (isinstance(formula, Window) and formula.a == 0):
        return False
    _, phi = from_first_read(formula.arg)
    windows = list(_windows(phi))
    return len(windows) == len(list(leaves(phi))) and all(
        window.a == 0 and not stl.is_temporal(window.arg) for window in windows
    )


def _windows(phi: stl.Formula) -> Iterator[Window]:
    return (leaf for leaf in leaves(phi) if isinstance(leaf, Window))


def _combined(phi: stl.Formula, leaf: Iterator[int]) -> Callable[[Truth], Truth]:
    """The and/or as a function of its leaves' verdicts (m, ...), in order of appearance; `leaf` counts them."""
    if not isinstance(phi, stl.And | stl.Or):
        return itemgetter(next(leaf))
    combine = np.logical_and if isinstance(phi, stl.And) else np.logical_or
    parts = [_combined(arg, leaf) for arg in phi.args]
    return lambda verdicts: reduce(combine, [part(verdicts) for part in parts])


def _paid(outer_f: bool, beta: float) -> Array:
    """The pay for sat = 0 and for sat = 1: exp(beta (sat - 1)) for F, -exp(-beta sat) for G."""
    return np.array([math.exp(-beta), 1.0] if outer_f else [-1.0, -math.exp(-beta)])
