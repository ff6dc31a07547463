"""The progress of a formula, or of one of its windows, in a memory of few numbers: for methods that pay its value.

The memory has a summary of the steps that are decided: the running maximum or minimum. If phi looks ahead itself, it
also has the last values of phi's leaves, as many samples as decide phi.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification, Truth
from stlbench_methods import formula_parts


class Outer(NamedTuple):
    """An operator F[a,b] phi or G[a,b] phi that is read at step 0."""

    steps: tuple[int, int]  # a and b
    phi: stl.Formula  # negations inside
    fold: stl.Fold


class Window:
    """F phi or G phi at the steps from `first` to `last`, and the bounds of phi over the box of the signals.

    Args:
        outer: the window.
        specification: the task's.
        values: the values of phi's leaves, and the semantics that combines them.
    """

    def __init__(self, outer: Outer, specification: Specification, values: formula_parts.Values) -> None:
        shift, phi = formula_parts.from_first_read(outer.phi) if stl.is_temporal(outer.phi) else (0, outer.phi)
        self.fold, self.first, self.last = outer.fold, outer.steps[0] + shift, outer.steps[1] + shift
        self.phi = stl.Quantity(phi, specification.signals, values.semantics, values.of)
        self.ahead = self.phi.horizon
        self.bounds = np.array([values.range(leaf) for leaf in self.phi.leaves]).T  # ends of the J leaves, (2, J)
        always = np.repeat(self.bounds[:, None], self.ahead + 1, axis=1)
        self.phi_ends: tuple[float, float] = tuple(self.phi.values(always)[:, 0])

    def ends_of(self, count: int) -> tuple[float, float]:
        """The least and the greatest value that so many steps can have."""
        return tuple(self.fold.read(self.fold.repeat(self.fold.lift(np.array(self.phi_ends)), [count] * 2)))


class RunningWindow(Window):
    """The value of a window, as far as it is known after the sample at step t.

    Memories are (N, size): the summary, and the values of the leaves at steps t - ahead to t, oldest first.
    """

    def __init__(self, outer: Outer, specification: Specification, values: formula_parts.Values) -> None:
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
        value = formula_parts.scaled(self.fold.read(memory[:, : self.fold.size])[:, None], *self.ends)
        if not self.ahead:
            return value
        history = formula_parts.scaled(self._history(memory), *self.bounds)
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


class Known(NamedTuple):
    value: Array  # (N,)
    counts: Truth  # (N,): where it does not count, it is as if the formula did not have it


def certain(value: Array) -> Known:
    return Known(value, np.ones(len(value), dtype=np.bool_))


Join: TypeAlias = Callable[[Sequence[Known]], Known]
"""The knowledge of the outermost windows, in order of appearance, becomes that of the formula."""


class Progress:
    """An and/or of windows F[a,b] phi, G[a,b] phi, each with its own part of the memory.

    In the fragment of eq. 2 the memory is one number for F psi and G psi, and for F[a,c1] G[c2,b] psi b - c2 + 2. Any
    other formula has a memory too: the last samples of the parts that look ahead inside a window. An until inside of no
    window has all its samples.

    Args:
        specification: the task's.
        values: the values of leaves, and the semantics that combines them.

    Raises:
        Unsuitable: an operator looks back.
    """

    def __init__(self, specification: Specification, values: formula_parts.Values) -> None:
        outer, self._join = outer_windows(specification.formula, values.semantics)
        self._windows = [RunningWindow(each, specification, values) for each in outer]
        self._cuts = np.cumsum([window.size for window in self._windows])[:-1]
        self.size = sum(window.size for window in self._windows)
        """Numbers of a memory."""
        self.input_size = sum(window.input_size for window in self._windows)
        low, high = self._joined([np.array(window.ends) for window in self._windows])
        self.ends = float(low), float(high)
        """The least and the greatest value over the box of the signals."""

    def begin(self, signals: Array, t: Integers) -> Array:
        """The memory at a first sample (N, k) at steps t (N,), as if it had been there since step 0: (N, size)."""
        return np.concatenate([each.begin(each.phi.read(signals), t) for each in self._windows], axis=1)

    def along(self, samples: Array, t: Integers, memory: Array) -> list[Array]:
        """The h memories (N, size) after each of the samples (h, N, k), the first of which is at steps t (N,)."""
        each = zip(self._windows, self._parts(memory), strict=True)
        after = [window.along(window.phi.read(samples), t, part) for window, part in each]
        return [np.concatenate(parts, axis=1) for parts in zip(*after, strict=True)]

    def so_far(self, memory: Array, t: Integers) -> Array:
        """The formula's value on the samples up to steps t, windows cut there (N,); at the end, its value."""
        return self._combined(RunningWindow.so_far, memory, t)

    def at_least(self, memory: Array, t: Integers) -> Array:
        """The least value that is possible after steps t while the signals are in their box: (N,)."""
        return self._combined(RunningWindow.at_least, memory, t)

    def inputs(self, memory: Array) -> Array:
        """All that there is to know of a memory, about in [-1, 1]: (N, input_size)."""
        each = zip(self._windows, self._parts(memory), strict=True)
        return np.concatenate([window.inputs(part) for window, part in each], axis=1)

    def _combined(self, value: Callable[[RunningWindow, Array, Integers], Array], memory: Array, t: Integers) -> Array:
        each = zip(self._windows, self._parts(memory), strict=True)
        return self._joined([value(window, part, t) for window, part in each])

    def _joined(self, values: Sequence[Array]) -> Array:
        return self._join([certain(value) for value in values]).value

    def _parts(self, memory: Array) -> list[Array]:
        return np.split(memory, self._cuts, axis=1)


def outer_windows(formula: stl.Formula, semantics: stl.Semantics) -> tuple[list[Outer], Join]:
    """The outermost windows of a formula, in order of appearance, and the function from their values to its value.

    A part that is no window is one of step 0 alone. Raises `Unsuitable` if an operator looks back.
    """
    formula_parts.refuse_past(formula)
    inside = stl.negations_inside(formula, to_predicates=semantics.divided)
    found = list[Outer]()
    join = _join(inside, semantics, found)
    return found, join


def _join(node: stl.Formula, semantics: stl.Semantics, found: list[Outer]) -> Join:
    """The function from the values of windows to that of the node; its windows are appended to those found before."""
    if isinstance(node, stl.And | stl.Or) and stl.is_temporal(node):
        fold = semantics.least if isinstance(node, stl.And) else semantics.greatest
        parts = [_join(arg, semantics, found) for arg in node.args]
        return lambda known: _folded(fold, [part(known) for part in parts])
    at = len(found)
    found.append(_outer(node, semantics))
    return lambda known: known[at]


def _folded(fold: stl.Fold, parts: Sequence[Known]) -> Known:
    """The fold of the parts that count; it counts if one of them does."""
    if all(part.counts.all() for part in parts):
        return Known(fold.of([part.value for part in parts]), parts[0].counts)
    values, counts = (np.stack(each, axis=-1) for each in zip(*parts, strict=True))
    lifted = np.where(counts[..., None], fold.lift(values), fold.empty)
    some: Truth = np.asarray(counts.any(axis=-1))
    return Known(np.where(some, fold.read(fold.merged(lifted)), 0.0), some)


def _outer(node: stl.Formula, semantics: stl.Semantics) -> Outer:
    match node:
        case stl.Always(a, b, arg):
            return Outer((a, b), arg, semantics.least)
        case stl.Eventually(a, b, arg):
            return Outer((a, b), arg, semantics.eventually)
        case _:
            return Outer((0, 0), node, stl.Least())


class Followed(RewardMethod):
    """Paid for the formula's value at the end; the memory is the formula's progress, and the policy sees all of it.

    Raises:
        Unsuitable: as `Progress` and `Margins`.
    """

    def __init__(
        self,
        specification: Specification,
        *,
        semantics: formula_parts.SemanticsName = "classic",
        sharpness: formula_parts.Sharpness = 10.0,
    ) -> None:
        super().__init__(specification)
        self._progress = Progress(
            specification, formula_parts.Margins(specification, stl.semantics(semantics, sharpness))
        )
        self.memory_size, self.input_size = self._progress.size, self._progress.input_size
        self.scale, self.floor = max(map(abs, self._progress.ends)), min(0.0, self._progress.ends[0])

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        return self._progress.begin(signals, t)

    def inputs(self, memory: Array) -> Array:
        return self._progress.inputs(memory)

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        memory = self._progress.along(samples[1:], t + 1, memory)[-1]
        return at_the_end(self._progress.so_far, self.specification.steps, len(samples) - 1, t, memory), memory


def at_the_end(value: Callable[[Array, Integers], Array], last: int, held: int, t: Integers, memory: Array) -> Array:
    """0, and at step `last` the value of the memory after it: rewards (held, N) of the transitions from steps t on."""
    rewards, end = np.zeros((held, len(t))), t + held
    if (over := end == last).any():
        rewards[-1, over] = value(memory[over], end[over])
    return rewards
