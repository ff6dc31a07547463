"""One window F[a,b] phi or G[a,b] phi in the course of an episode, in a memory of few numbers.

The memory has a summary of the steps that are decided: the running maximum or minimum. If phi looks ahead itself, it
also has the last values of phi's leaves, as many samples as decide phi.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Specification, Truth
from stlbench_methods.values import Values
from stlbench_methods.windows import from_first_read, scaled


class Outer(NamedTuple):
    """An operator F[a,b] phi or G[a,b] phi that is read at step 0."""

    steps: tuple[int, int]  # a and b
    phi: stl.Formula  # negations inside
    fold: stl.Fold


class Window:
    """F phi or G phi at the steps from `first` to `last`, and the bounds of phi over the box of the signals.

    Args:
        outer: the window.
        specification: of the task.
        values: what the leaves of phi are worth, and how they are combined.
    """

    def __init__(self, outer: Outer, specification: Specification, values: Values) -> None:
        shift, phi = from_first_read(outer.phi) if stl.is_temporal(outer.phi) else (0, outer.phi)
        self.fold, self.first, self.last = outer.fold, outer.steps[0] + shift, outer.steps[1] + shift
        self.phi = stl.Quantity(phi, specification.signals, values.semantics, values.of)
        self.ahead = self.phi.horizon
        self.bounds = np.array([values.range(leaf) for leaf in self.phi.leaves]).T  # of the leaves, (2, J)
        always = np.repeat(self.bounds[:, None], self.ahead + 1, axis=1)
        self.phi_ends: tuple[float, float] = tuple(self.phi.values(always)[:, 0])

    def ends_of(self, count: int) -> tuple[float, float]:
        """The least and the greatest value that so many steps can have."""
        return tuple(self.fold.read(self.fold.repeat(self.fold.lift(np.array(self.phi_ends)), [count] * 2)))


class RunningWindow(Window):
    """The value of a window, as far as it is known after the sample at step t.

    Memories are (N, size): the summary, and the values of the leaves at steps t - ahead to t, oldest first.
    """

    def __init__(self, outer: Outer, specification: Specification, values: Values) -> None:
        super().__init__(outer, specification, values)
        self.ends = self.ends_of(self.last - self.first + 1)
        empty = self.phi_ends[0 if self.fold.sign < 0 else 1]  # an empty F is as bad as can be, an empty G as good
        self._nothing = self.fold.lift(np.array(empty))
        history = (self.ahead + 1) * len(self.phi.leaves) if self.ahead else 0
        self.size, self.input_size = self.fold.size + history, 1 + history

    def begin(self, leaves: Array, t: Integers) -> Array:
        """The memory at a first sample at steps t (N,), as if it had been the sample at each step before: (N, size)."""
        history = np.repeat(leaves[:, None], self.ahead + 1, axis=1)
        count = np.clip(t - self.ahead - self.first + 1, 0, self.last - self.first + 1)
        summary = self.fold.repeat(self.fold.lift(self.phi.values(history)[:, 0]), np.maximum(count, 1))
        summary = np.where(count[:, None] > 0, summary, self._nothing)
        return self._joined(summary, history)

    def along(self, leaves: Array, t: Integers, memory: Array) -> list[Array]:
        """The h memories (N, size) after each of the values (h, N, J), the first of which is of steps t (N,)."""
        path = leaves.transpose(1, 0, 2)
        if self.ahead:
            path = np.concatenate([self._history(memory)[:, 1:], path], axis=1)
        summary, told = memory[:, : self.fold.size], t + np.arange(len(leaves))[:, None] - self.ahead
        inside = (told >= self.first) & (told <= self.last)
        values = self.fold.lift(self.phi.values(path)) if inside.any() else np.empty((len(t), 0, self.fold.size))
        after = list[Array]()
        for i in range(len(leaves)):
            if inside[i].any():
                now, begins = values[:, i], told[i] == self.first
                grown = np.where(begins[:, None], now, self.fold.merge(summary, now))
                summary = grown if inside[i].all() else np.where(inside[i][:, None], grown, summary)
            after.append(self._joined(summary, path[:, i : i + self.ahead + 1]))
        return after

    def so_far(self, memory: Array, t: Integers) -> Array:
        """The value of the samples up to steps t, windows cut there: (N,). An empty one has the end of its range."""
        if not self.ahead:
            return self.fold.read(memory[:, : self.fold.size])
        values = self.phi.clipped(self._history(memory), self.phi_ends)[:, 1:]
        summary = self._with(values, memory, t, np.minimum(self.last, t))
        return self.fold.read(np.where((t < self.first)[:, None], self._nothing, summary))

    def at_least(self, memory: Array, t: Integers) -> Array:
        """The least value that is possible after steps t while the signals are in their box: (N,)."""
        to_come = self.fold.lift(np.full(len(memory), self.phi_ends[0]))
        to_come = self.fold.repeat(to_come, np.clip(self.last - np.maximum(t, self.first - 1), 0, None))
        values = np.empty((len(memory), 0))
        if self.ahead and (t - self.ahead < self.last).any():
            worst = np.broadcast_to(self.bounds[0], (len(memory), self.ahead, self.bounds.shape[1]))
            values = self.phi.values(np.concatenate([self._history(memory), worst], axis=1))[:, 1:]
        known = self._with(values, memory, t, np.full(len(memory), self.last))
        return self.fold.read(self.fold.merge(known, to_come))

    def inputs(self, memory: Array) -> Array:
        value = scaled(self.fold.read(memory[:, : self.fold.size])[:, None], *self.ends)
        if not self.ahead:
            return value
        history = scaled(self._history(memory), *self.bounds)
        return np.concatenate([value, history.reshape(len(memory), -1)], axis=1)

    def _with(self, values: Array, memory: Array, t: Integers, last: Integers) -> Array:
        """The summary, and with it those of the newest steps' values (N, h) that count, up to steps `last` (N,)."""
        decided = (t - self.ahead >= self.first)[:, None]
        summary = np.where(decided, memory[:, : self.fold.size], self.fold.empty)
        if not values.shape[1]:
            return summary
        steps = t[:, None] - np.arange(values.shape[1])[::-1]
        counts: Truth = (steps >= self.first) & (steps <= last[:, None])
        newest = np.where(counts[..., None], self.fold.lift(values), self.fold.empty)
        merged: Array = self.fold.merged(np.concatenate([summary[:, None], newest], axis=1))
        return merged

    def _history(self, memory: Array) -> Array:
        return memory[:, self.fold.size :].reshape(len(memory), self.ahead + 1, -1)

    def _joined(self, summary: Array, history: Array) -> Array:
        return np.concatenate([summary, history.reshape(len(history), -1)], axis=1) if self.ahead else summary
