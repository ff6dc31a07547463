"""How far a formula is after some samples, in a memory of few numbers: for methods that are paid for its value."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeAlias

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification, Truth
from stlbench_methods.running_window import Outer, RunningWindow
from stlbench_methods.values import Margins, SemanticsName, Sharpness, Values
from stlbench_methods.windows import refuse_past


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
    other formula has a memory too: the last samples of what looks ahead inside a window; all of them, where an until is
    inside of no window.

    Args:
        specification: of the task.
        values: what leaves are worth, and how they are combined.

    Raises:
        Unsuitable: an operator looks back.
    """

    def __init__(self, specification: Specification, values: Values) -> None:
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
    """The outermost windows of a formula, in order of appearance, and how their values become its value.

    A part that is no window is one of step 0 alone. Raises `Unsuitable` where an operator looks back.
    """
    refuse_past(formula)
    inside = stl.negations_inside(formula, to_predicates=semantics.divided)
    found = list[Outer]()
    join = _join(inside, semantics, found)
    return found, join


def _join(node: stl.Formula, semantics: stl.Semantics, found: list[Outer]) -> Join:
    """How the values of windows become that of the node; its windows are appended to those found before."""
    if isinstance(node, stl.And | stl.Or) and stl.is_temporal(node):
        fold = semantics.least if isinstance(node, stl.And) else semantics.greatest
        parts = [_join(arg, semantics, found) for arg in node.args]
        return lambda known: _folded(fold, [part(known) for part in parts])
    at = len(found)
    found.append(_outer(node, semantics))
    return lambda known: known[at]


def _folded(fold: stl.Fold, parts: Sequence[Known]) -> Known:
    """The fold of the parts that count; it counts where one of them does."""
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
    """Paid for the formula's value at the end; the memory is how far the formula is, and the policy sees all of it.

    Raises:
        Unsuitable: as `Progress` and `Margins`.
    """

    def __init__(
        self, specification: Specification, *, semantics: SemanticsName = "classic", sharpness: Sharpness = 10.0
    ) -> None:
        super().__init__(specification)
        self._progress = Progress(specification, Margins(specification, stl.semantics(semantics, sharpness)))
        self.memory_size, self.scale = self._progress.size, max(map(abs, self._progress.ends))

    @property
    def input_size(self) -> int:
        return self._progress.input_size

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
