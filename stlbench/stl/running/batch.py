"""An online monitor of many traces at once, as a vector environment makes them: `scalar` with a NumPy call per number.

Arrays are (n,), one value per trace. Each trace has its own clock, and `now` are the clocks; traces whose clock lies
outside start..stop of an operator are carried along and do not change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from stlbench.stl.errors import UndefinedError, shorten
from stlbench.stl.language.structure import as_names, check_names, require_formula, signals
from stlbench.stl.language.syntax import Formula
from stlbench.stl.predicates import as_array, compile_arrays, evaluated
from stlbench.stl.predicates.writer import SIDE
from stlbench.stl.recorded.evaluator import cause
from stlbench.stl.running.monitor import State, program
from stlbench.stl.running.nested import Streamed as OneStreamed
from stlbench.stl.running.nested import one
from stlbench.stl.running.tree import Ends, Interval, Kit, Leaf, Pointwise, Tree, UnsupportedError, last_step
from stlbench.stl.running.unfolding import Decided, Known, Recent, Unfolding

Floats: TypeAlias = NDArray[np.float64]
Steps: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]
#: a mask or indices of traces
Which: TypeAlias = Any


class Intervals(NamedTuple):
    """The bounds of each of n traces; arrays (n,), not to be written to.

    Attributes:
        lower, upper: bounds of the robustness at t = 0 over all continuations.
        certainly: whether the bounds tell that every continuation satisfies the formula (Boolean semantics).
        possibly: whether they leave it open that some continuation does.
    """

    lower: Floats
    upper: Floats
    certainly: Mask
    possibly: Mask


class BatchMonitor:
    """Watches `count` traces for `formula`, each on its own clock: a `Monitor` for each trace.

    G, F, G F, F G and until over formulas without temporal operators cost a fixed number of NumPy calls per step. Other
    formulas that cost `Monitor` constant work cost as much for each trace here; where there are many traces and short
    windows, they are evaluated anew at each step, once for all traces of one age, and so is the rest. `copy.deepcopy`
    forks it, `pickle` stores it.

    Raises:
        UnknownSignalError: the formula uses a signal that is not in `names`.
    """

    def __init__(self, formula: Formula, names: Sequence[str], count: int) -> None:
        """Start before the first samples; `names` are the signals of a sample, in order; count >= 1."""
        require_formula(formula)
        self.formula, self.names = formula, as_names(names, formula)
        check_names(formula, self.names)
        if not isinstance(count, int | np.integer):
            raise TypeError(f"count is a whole number of traces, got {shorten(repr(count))}")
        if count < 1:
            raise ValueError(f"a batch has at least 1 trace, got {count}")
        self.horizon, self._read = last_step(formula), frozenset(signals(formula))
        self.steps: Steps = np.zeros(count, dtype=np.int64)
        self._tree = Tree(formula, self.names, many(count))
        self._youngest = self._oldest = 0  # of the clocks
        self._answer = self._bounds()

    def update(self, samples: ArrayLike) -> Intervals:
        """Take the next sample of each trace (n, k) and return the bounds. Later arrays do not share memory.

        Raises:
            UndefinedError: a predicate that is read has no value at a sample: a signal is NaN, or its arithmetic has
                none. All traces stay as they were before.
            TypeError: what is read is no real number, or the array is masked.
            ValueError: the samples are not of shape (n, k).
        """
        rows = np.array(as_array(samples, self.names, self._read), dtype=np.float64)
        if rows.shape != (expected := (len(self.steps), len(self.names))):
            raise ValueError(f"samples have shape {expected} for {', '.join(self.names)}, got {rows.shape}")
        reading = [leaf for leaf in self._tree.leaves if leaf.start <= self._oldest and self._youngest <= leaf.stop]
        with np.errstate(all="ignore"):
            try:
                values = [leaf.read(self.steps, rows) for leaf in reading]
            except UndefinedError as error:
                sample = None if error.trace is None else int(self.steps[error.trace])
                raise UndefinedError(error.what, sample, error.trace) from None
            for leaf, value in zip(reading, values, strict=True):
                leaf.take(self.steps, value)
        self.steps += 1
        self._youngest += 1
        self._oldest += 1
        if reading:
            self._answer = self._bounds()
        return self._answer

    def restart(self, which: ArrayLike) -> None:
        """Start some traces anew, before their next sample: a mask (n,) of booleans, or indices, none allowed.

        Raises:
            ValueError: a mask of another length, an index outside 0..n-1, or no mask and no indices at all.
        """
        chosen = self._indices(which)
        self.steps[chosen] = 0
        for leaf in self._tree.leaves:
            leaf.restart(chosen)
        self._youngest, self._oldest = int(self.steps.min()), int(self.steps.max())
        self._answer = self._bounds()

    def _indices(self, which: ArrayLike) -> Steps:
        chosen, count = np.atleast_1d(np.asanyarray(which)), len(self.steps)
        if hasattr(chosen, "mask"):  # of a masked array, whose values do not count alone
            chosen = chosen.astype(object)
        if chosen.dtype == np.bool_ and chosen.shape == (count,):
            return np.flatnonzero(chosen)
        if chosen.size == 0:
            return np.empty(0, dtype=np.int64)
        if chosen.ndim == 1 and chosen.dtype.kind in "iu" and chosen.min() >= 0 and chosen.max() < count:
            return chosen.astype(np.int64)
        shown = shorten(f"{chosen.tolist()} of type {type(which).__name__} and {chosen.dtype}")
        raise ValueError(f"which traces: a mask of {count} booleans, or indices from 0 to {count - 1}; got {shown}")

    def _bounds(self) -> Intervals:
        lower, upper = self._tree.root.bounds()
        return Intervals(_robustness(lower), _robustness(upper), lower > 0.0, upper > 0.0)


def _robustness(signed: Floats) -> Floats:
    return np.where(abs(signed) <= SIDE, 0.0, signed)


# ---------------------------------------------------------------------------------------------------------- operators


class Operator(Leaf):
    """A leaf that takes the samples of `count` traces; `initial` are its bounds before the first."""

    def __init__(self, count: int, start: int, stop: int, initial: Ends, flipped: bool) -> None:
        super().__init__(start, stop, flipped)
        self.count, self._kept = count, list[tuple[Floats, float]]()
        self.ends: Ends = self.kept(initial[0]), self.kept(initial[1])

    def kept(self, initial: float) -> Floats:
        """A number of each trace, which a restart sets back."""
        values = np.full(self.count, initial)
        self._kept.append((values, initial))
        return values

    def read(self, now: Steps, samples: Floats) -> Any:
        """The part of the next samples (n, k) that `take` needs; it changes nothing. UndefinedError has the trace."""
        raise NotImplementedError

    def take(self, now: Steps, value: Any) -> None:
        raise NotImplementedError

    def restart(self, which: Which) -> None:
        for values, initial in self._kept:
            values[which] = initial

    def within(self, now: Steps) -> Mask:
        mask: Mask = (now >= self.start) & (now <= self.stop)
        return mask


class Until(Operator):
    """left U[a,b] right: the least of left so far (`guard`) and the best of right within it. Without left: F."""

    def __init__(self, count: int, left: Pointwise | None, right: Pointwise, interval: Interval, flipped: bool) -> None:
        self.a, stop = interval
        initial = (-np.inf, np.inf) if left else right.unknown
        super().__init__(count, 0 if left else self.a, stop, initial, flipped)
        self.left, self.right = left, right
        self.best, self.guard = self.kept(-np.inf), self.kept(np.inf)

    def read(self, now: Steps, samples: Floats) -> tuple[Floats | None, Floats]:
        within = self.within(now)
        if self.left is None:
            return None, self.right.value(samples, within)
        guard = self.left.value(samples, now < self.stop)
        return guard, self.right.value(samples, within & (now >= self.a))

    def take(self, now: Steps, value: tuple[Floats | None, Floats]) -> None:
        guard, goal = value
        active, before = self.within(now), now < self.stop
        if self.left is None or guard is None:
            np.maximum(self.best, goal, out=self.best, where=active)
            for end, unknown in zip(self.ends, self.right.unknown, strict=True):
                np.maximum(self.best, np.where(before, unknown, -np.inf), out=end, where=active)
            return
        np.maximum(self.best, np.minimum(goal, self.guard), out=self.best, where=active & (now >= self.a))
        np.minimum(self.guard, guard, out=self.guard, where=before)
        for end, left, right in zip(self.ends, self.left.unknown, self.right.unknown, strict=True):
            ahead = np.minimum(self.guard, np.where(now >= self.a - 1, right, min(left, right)))
            np.maximum(self.best, np.where(before, ahead, -np.inf), out=end, where=active)


#: samples of all traces in a window that are kept as they are: 8 MB
WIDE = 2**20


class Nested(Operator):
    def __init__(self, count: int, psi: Pointwise, outer: Interval, inner: Interval, flipped: bool) -> None:
        (a, c), (d, e) = outer, inner
        super().__init__(count, a + d, c + e, psi.unknown, flipped)
        self.psi, self.first, self.last = psi, a + e, c + d
        width = e - d + 1
        self.window = (SlidingLeast if count * width <= WIDE else SlidingQueue)(count, width)
        self.best, self.open = self.kept(-np.inf), self.kept(np.inf)

    def read(self, now: Steps, samples: Floats) -> Floats:
        return np.asarray(self.psi.value(samples, self.within(now)))

    def take(self, now: Steps, value: Floats) -> None:
        """All windows slide together: one that counts lies within a single run of a trace."""
        active = self.within(now)
        np.maximum(self.best, self.window.step(value), out=self.best, where=active & (now >= self.first))
        np.minimum(self.open, value, out=self.open, where=active & (now >= self.last))
        for end, unknown in zip(self.ends, self.psi.unknown, strict=True):
            ahead = np.where(now < self.stop, np.minimum(self.open, unknown), -np.inf)
            np.maximum(self.best, ahead, out=end, where=active)


class SlidingLeast:
    """Minimum of the last `width` samples, in constant amortised work and `width` samples of memory per trace.

    Samples come in blocks of `width`. A window is the end of the block before, whose minima to its end were worked out
    when it was full, and the beginning of this block, whose minimum is updated with each sample.
    """

    def __init__(self, count: int, width: int) -> None:
        self.rows = np.full((width, count), np.inf)
        self.beginning = np.full(count, np.inf)
        self.at = 0

    def step(self, values: Floats) -> Floats:
        """Take (n,), return the minima of the last `width`; means nothing before as many were taken."""
        self.beginning = np.minimum(self.beginning, values) if self.at else values
        self.rows[self.at] = values
        self.at += 1
        if self.at < len(self.rows):
            return np.asarray(np.minimum(self.beginning, self.rows[self.at]))
        self.at = 0
        self.rows = np.minimum.accumulate(self.rows[::-1], axis=0)[::-1]
        return self.beginning


class SlidingQueue:
    """The same for wide windows, in more calls a step: keeps of each trace what may still be a minimum.

    These are few, unless samples rise for a long time: of a random sequence about the logarithm of `width`.
    """

    def __init__(self, count: int, width: int) -> None:
        self.width, self.now = width, 0
        self.values: Floats = np.empty((count, 8))
        self.steps: Steps = np.empty((count, 8), dtype=np.int64)
        self.first, self.after = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        self.each = np.arange(count)

    def step(self, values: Floats) -> Floats:
        """Take (n,), return the minima of the last `width`."""
        if self.after.max() == self.values.shape[1]:
            self._make_room()
        worse = np.ones(len(self.each), dtype=np.bool_)
        while (worse := worse & (self.after > self.first) & (self.values[self.each, self.after - 1] >= values)).any():
            self.after -= worse
        self.values[self.each, self.after], self.steps[self.each, self.after] = values, self.now
        self.after += 1
        self.first += self.steps[self.each, self.first] <= self.now - self.width
        self.now += 1
        return np.asarray(self.values[self.each, self.first])

    def _make_room(self) -> None:
        """Move each queue to the beginning of its row; rows are at least twice as long as the longest."""
        lengths = self.after - self.first
        room = np.arange(max(8, 2 * int(lengths.max()) + 2))
        kept = np.minimum(self.first[:, None] + room, self.values.shape[1] - 1)
        self.values = np.take_along_axis(self.values, kept, axis=1)
        self.steps = np.take_along_axis(self.steps, kept, axis=1)
        self.first, self.after = np.zeros_like(self.first), lengths


#: more traces, with fewer samples in a window, are evaluated together: that is cheaper than 1.8 us for each
MANY, NARROW = 64, 128


class Streamed(Operator):
    """Nested and past formulas as streams: each trace has the state of a `Monitor`."""

    def __init__(self, count: int, formula: Formula, names: tuple[str, ...], negated: bool) -> None:
        """Raises UnsupportedError where the formula is no stream."""
        (leaf,) = Tree(formula, names, one()).leaves
        if not isinstance(leaf, OneStreamed) or (count > MANY and Unfolding(formula, names).window <= NARROW):
            raise UnsupportedError
        self._of = formula, names
        self._begin, self._step, _ = program(*self._of)
        self.states = [State() for _ in range(count)]
        for state in self.states:
            self._begin(state)
        super().__init__(count, 0, leaf.stop, self._ends(self.states[0]), negated)
        self.parts = [(_Value(psi, names, False), *span) for psi, span in leaf.spans.items()]

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in ("_begin", "_step")}

    def __setstate__(self, state: Mapping[str, Any]) -> None:
        vars(self).update(state)
        self._begin, self._step, _ = program(*self._of)  # functions that are made cannot be pickled

    def _ends(self, state: State) -> Ends:
        return state.lower0, state.upper0  # type: ignore[attr-defined]  # of operator 0

    def read(self, now: Steps, samples: Floats) -> list[list[float]]:
        for value, first, last in self.parts:
            value(samples, (now >= first) & (now <= last))
        return samples.tolist()  # type: ignore[no-any-return]

    def take(self, now: Steps, value: list[list[float]]) -> None:
        for state, sample in zip(self.states, value, strict=True):
            self._step(state, sample)
        for end, new in zip(self.ends, zip(*map(self._ends, self.states), strict=True), strict=True):
            end[:] = new

    def restart(self, which: Which) -> None:
        super().restart(which)
        for trace in np.atleast_1d(which):
            self._begin(self.states[trace])


class Replayed(Operator):
    """Any other formula: evaluates what is not decided at each step, traces of one phase together."""

    def __init__(self, count: int, formula: Formula, names: tuple[str, ...], negated: bool) -> None:
        self.until = Unfolding(formula, names)
        super().__init__(count, 0, self.until.last, (-np.inf, np.inf), self.until.flipped is not negated)
        self.samples = Recent(count, len(names))
        before: dict[Formula, Floats] = {node: np.empty(count) for node in self.until.carried}
        self.state = Decided(self.kept(-np.inf), self.kept(np.inf), before)

    def read(self, now: Steps, samples: Floats) -> list[tuple[Steps, Known]]:
        rows, known = np.flatnonzero(self.within(now)), list[tuple[Steps, Known]]()
        phases = self.until.phases(now[rows])
        for age in np.unique(phases).tolist():
            same = rows[phases == age]
            recent = self.samples.with_newest(samples, min(age + 1, self.until.window))[same]
            before = {node: values[same] for node, values in self.state.before.items()}
            try:
                state = Decided(self.state.best[same], self.state.guard[same], before)
                known.append((same, self.until.read(recent, age, state)))
            except UndefinedError as error:
                raise UndefinedError(error.what, trace=int(same[error.trace or 0])) from None
        return known

    def take(self, now: Steps, value: list[tuple[Steps, Known]]) -> None:
        self.samples.take(min(int(now.max()) + 1, self.until.window))
        for same, known in value:
            for end, new in zip(self.ends, (known.lower, known.upper), strict=True):
                end[same] = new
            self.state.best[same], self.state.guard[same] = known.state.best, known.state.guard
            for node, values in known.state.before.items():
                self.state.before[node][same] = values


def many(count: int) -> Kit[Operator]:
    kinds = [partial(kind, count) for kind in (Until, Nested, Streamed, Replayed)]
    return Kit(np.minimum.reduce, np.maximum.reduce, _Value, *kinds)


class _Value:
    """(samples (n, k), the traces that must have a value) -> signed margins (n,). Code is made anew from a pickle."""

    def __init__(self, psi: Formula, names: tuple[str, ...], negated: bool) -> None:
        self._of, self._compiled = (psi, names, negated), compile_arrays(psi, names, "signed", negated)

    def __reduce__(self) -> tuple[Any, ...]:
        return _Value, self._of

    def __deepcopy__(self, memo: dict[int, Any]) -> _Value:
        return self

    def __call__(self, samples: Floats, needed: Mask) -> Floats:
        if not callable(self._compiled):
            return np.full(len(samples), self._compiled)
        psi, names, _ = self._of
        values, wrong = evaluated(self._compiled, psi, names, samples)
        if wrong is not None and (wrong & needed).any():
            trace = int((wrong & needed).argmax())
            raise UndefinedError(cause(psi, names, samples[trace]), trace=trace)
        return values
