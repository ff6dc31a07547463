"""An outer F[a,b] phi or G[a,b] phi of the newest samples alone."""

from __future__ import annotations

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Specification, Truth
from stlbench_methods.progress import Known
from stlbench_methods.running_window import Outer
from stlbench_methods.values import Values
from stlbench_methods.windows import from_first_read


class NewestSamples:
    """The value of F phi or G phi on some of the last `count` samples, whose leaves are the memory (N, size).

    Args:
        outer: the operator. It counts at the steps which it observes.
        specification: of the task.
        values: what the leaves of phi are worth, and how they are combined.
        count: samples.
    """

    def __init__(self, outer: Outer, specification: Specification, values: Values, count: int) -> None:
        shift, phi = from_first_read(outer.phi) if stl.is_temporal(outer.phi) else (0, outer.phi)
        self._phi = stl.Quantity(phi, specification.signals, values.semantics, values.of)
        self._fold, self._count = outer.fold, count
        self._first, self._last = outer.steps[0] + shift, outer.steps[1] + shift + self._phi.horizon
        self._bounds = np.array([values.range(leaf) for leaf in self._phi.leaves]).T
        always = np.repeat(self._bounds[:, None], self._phi.horizon + 1, axis=1)
        self._phi_ends: tuple[float, float] = tuple(self._phi.values(always)[:, 0])
        once = self._fold.lift(np.array(self._phi_ends))
        few, many = (self._fold.read(self._fold.repeat(once, [n, n])) for n in (1, count))
        self.ends = float(min(few[0], many[0])), float(max(few[1], many[1]))
        """The least and the greatest value over the box of the signals."""
        self.size = count * len(self._phi.leaves)

    def begin(self, signals: Array) -> Array:
        """The memory at a first sample (N, k): copies of it."""
        return np.tile(self._phi.read(signals), self._count)

    def path(self, samples: Array, memory: Array) -> Array:
        """The leaves of the memory and of h more samples (h, N, k), in order of time: (N, count + h, J)."""
        known = memory.reshape(len(memory), self._count, -1)
        return np.concatenate([known, self._phi.read(samples).transpose(1, 0, 2)], axis=1)

    def known(self, leaves: Array, t: Integers, begin: Integers) -> Known:
        """The value of the samples at steps `begin` (N,) to t (N,), given the leaves of the last (N, count, J)."""
        values = self._phi.clipped(leaves, self._phi_ends)
        steps = t[:, None] - np.arange(self._count)[::-1]
        read: Truth = steps >= np.maximum(begin, self._first)[:, None]
        lifted = np.where(read[..., None], self._fold.lift(values), self._fold.empty)
        counts: Truth = (t >= self._first) & (t <= self._last) & (begin <= t)
        value = self._fold.read(self._fold.merged(lifted))
        return Known(np.where(counts, value, 0.0), counts)

    def inputs(self, memory: Array) -> Array:
        """The leaves, each range scaled to [-1, 1]: (N, size)."""
        low, high = np.tile(self._bounds, self._count)
        scaled: Array = (memory - (low + high) / 2) / (np.maximum(high - low, 1e-9) / 2)
        return scaled
