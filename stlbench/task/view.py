"""The formula's view: the part of an observation that comes from the formula and the ranges of the signals alone."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Truth
from stlbench.stl import Binary, Call, Expression, Formula, Negative, Predicate
from stlbench.stl.language.structure import walk
from stlbench.task.forms import Box, Window, as_margin, reach, scale, windows

FEW_GOALS = 6
"""A policy sees the quantities of all goals at all times in a group of at most so many."""
MOST_FEATURES = 64
"""An environment with more numbers than this, such as pictures, shows no products with directions."""
_INSIDE = frozenset({"norm", "norminf", "abs", "hypot"})


@dataclass(frozen=True)
class _Quantity:
    """A margin of a predicate, or an argument of a norm or an absolute value inside of one."""

    source: Predicate | Expression
    near: float
    far: float

    @property
    def sizes(self) -> tuple[float, ...]:
        """The sizes at which it is shown, largest first: one to three."""
        sizes = [self.far]
        if self.far > 30 * self.near:  # between two sizes so far apart, neither column would change much
            sizes.append(float(np.sqrt(self.near * self.far)))
        if self.near < 0.9 * self.far:
            sizes.append(self.near)
        return tuple(sizes)

    def __str__(self) -> str:
        return f"margin of {self.source}" if isinstance(self.source, Predicate) else str(self.source)


class _Columns:
    """Quantities at all their sizes, evaluated at once."""

    def __init__(self, quantities: Iterable[_Quantity], names: tuple[str, ...]) -> None:
        self.quantities = tuple(dict.fromkeys(quantities))
        self.place = {quantity: place for place, quantity in enumerate(self.quantities)}
        pairs = [(place, size) for place, each in enumerate(self.quantities) for size in each.sizes]
        self._places = np.array([place for place, _ in pairs], dtype=np.int64)
        self._sizes = np.array([size for _, size in pairs])
        self._ranged = np.array([size == self.quantities[place].far for place, size in pairs], dtype=np.bool_)
        self._functions = [
            stl.margin(each.source if isinstance(each.source, Predicate) else as_margin(each.source), names)
            for each in self.quantities
        ]

    def of(self, quantities: Iterable[_Quantity]) -> list[int]:
        """The columns of quantities."""
        places = dict.fromkeys(self.place[quantity] for quantity in quantities)
        return [int(column) for place in places for column in np.flatnonzero(self._places == place)]

    def __call__(self, signals: Array) -> tuple[Array, Array]:
        """The values (N, q + 1) and the columns (N, c + 1) at signals (N, k), each with zeros in the last place."""
        zeros = np.zeros((len(signals), 1))
        values = np.stack([function(signals) for function in self._functions], axis=1)
        ratios = values[:, self._places] / self._sizes
        columns = np.where(self._ranged, ratios.clip(-1.0, 1.0), _squashed(ratios))
        return np.concatenate([values, zeros], axis=1), np.concatenate([columns, zeros], axis=1)


class _Turns:
    """Goals over the same signals, which take turns by their deadlines."""

    def __init__(self, goals: Sequence[tuple[Window, Sequence[_Quantity]]], columns: _Columns, steps: int) -> None:
        """Args: `goals` with their quantities, the earliest deadline first; `steps` T of the task."""
        ends = np.array([goal.end for goal, _ in goals], dtype=np.int64)
        times = np.arange(steps + 1)
        self._next = np.minimum(np.searchsorted(ends, times), len(ends) - 1)
        empty_column, empty_value = len(columns.of(columns.quantities)), len(columns.quantities)
        self._slot = _table([columns.of(own) for _, own in goals], empty_column)
        self._direction = _table([[columns.place[each] for each in _directions(own)] for _, own in goals], empty_value)
        self._near = min(each.near for _, own in goals for each in own)
        edges = np.array([(goal.begin, goal.end) for goal, _ in goals])[self._next]
        left = (edges - times[:, None]) / steps
        turn = np.where(self._next[:, None] == np.arange(len(goals)), 1.0, -1.0)
        parts = [_squashed(left / 0.25), _squashed(left / 0.03)]
        self._clock = np.concatenate([turn, *parts] if len(goals) > 1 else parts, axis=1)

    def shown(self, columns: Array, t: Integers) -> tuple[Array, Array]:
        """The quantities of the next goal (N, s), and which goal it is with the time until its window (N, c)."""
        return np.take_along_axis(columns, self._slot[self._next[t]], axis=1), self._clock[t]

    def direction(self, values: Array, t: Integers) -> Array:
        """The direction to the next goal, shorter within its near size: (N, a)."""
        vector = np.take_along_axis(values, self._direction[self._next[t]], axis=1)
        length = np.sqrt((vector**2).sum(axis=1, keepdims=True))
        direction: Array = vector / np.maximum(length, 1e-9) * _squashed(length / self._near)
        return direction


class FormulaView:
    """The part of an observation after the state, on the track `auto`. It serves every system and environment.

    The windows of the formula are invariants and goals. Goals over the same signals form a group, in which they take
    turns by their deadlines. The view shows, in this order:

    - each quantity of the invariants, and of the goals of small groups. A quantity is the margin of a predicate or an
      argument of a norm in it, which is a direction. It is shown over its range, and squashed at its near size;
    - of each group the quantities of the next goal, always in the same columns, so that a network treats all goals
      alike. Then which goal that is, and the time until its window begins and ends, at two sizes;
    - the products of the state's numbers with the directions to the next goals.

    The number of columns grows linearly with the formula. All functions are exactly rounded, so that every processor
    computes the same bits.
    """

    revision = 1  # which state of it a result is of: raise it where its columns change

    def __init__(self, formula: Formula, box: Box, steps: int, bent: Truth | None = None) -> None:
        """Lay out the columns.

        Args:
            formula: intervals in steps.
            box: the ranges of the signals.
            steps: T of the task.
            bent: (d,), the numbers of the state that are multiplied with directions; all if left out.
        """
        parts = {window: tuple(dict.fromkeys(_quantities(window, box))) for window in windows(formula)}
        groups = dict[tuple[str, ...], list[Window]]()
        for window in sorted(parts, key=lambda window: (window.end, window.begin)):
            if not window.invariant and parts[window]:
                groups.setdefault(tuple(sorted(stl.signals(window.psi))), []).append(window)
        self._columns = _Columns((each for own in parts.values() for each in own), tuple(box))
        always = [window for window in parts if window.invariant]
        always += [window for group in groups.values() if 1 < len(group) <= FEW_GOALS for window in group]
        self._shown = np.array(self._columns.of(each for window in always for each in parts[window]), dtype=np.int64)
        goals = [[(window, parts[window]) for window in group] for group in groups.values()]
        self._turns = [_Turns(group, self._columns, steps) for group in goals]
        self._bent = bent
        first = next((_directions(parts[window]) for window in always if not groups), ())
        self._fixed = np.array([self._columns.place[each] for each in first], dtype=np.int64)
        self._fixed_near = np.array([each.near for each in first])

    @property
    def quantities(self) -> tuple[str, ...]:
        """The names of the quantities that are shown, for people."""
        return tuple(dict.fromkeys(map(str, self._columns.quantities)))

    def __call__(self, state: Array, signals: Array, t: Integers) -> Array:
        """The columns of N copies: the state's numbers (N, d), signals (N, k), steps t (N,) in 0..T -> (N, v)."""
        if not self._columns.quantities:
            return np.empty((len(t), 0))
        values, columns = self._columns(signals)
        parts = [columns[:, self._shown]]
        for turns in self._turns:
            parts += turns.shown(columns, t)
        if state.shape[1] <= MOST_FEATURES:
            directions = [turns.direction(values, t) for turns in self._turns]
            vector = np.concatenate([*directions, _squashed(values[:, self._fixed] / self._fixed_near)], axis=1)
            numbers = state if self._bent is None else state[:, self._bent]
            parts.append((numbers[:, :, None] * vector[:, None, :]).reshape(len(t), -1))
        return np.concatenate(parts, axis=1)


def bent_columns(state: Array, signals: Array) -> Truth:
    """Which numbers of the state (M, d) say more than an affine function of the signals (M, k): (d,).

    All do if a number is not finite, as nothing can then be fitted.
    """
    if not (np.isfinite(state).all() and np.isfinite(signals).all()):
        return np.ones(state.shape[1], dtype=np.bool_)
    # More than a thousandth of a number's variance is left, and more than rounding leaves of one that never changes.
    known = np.concatenate([np.ones((len(signals), 1)), signals], axis=1)
    rest = state - known @ np.linalg.lstsq(known, state, rcond=None)[0]
    bent: Truth = (rest**2).mean(axis=0) > 1e-3 * state.var(axis=0) + 1e-12
    return bent


def _quantities(window: Window, box: Box) -> Iterator[_Quantity]:
    for predicate in walk(window.psi):
        if isinstance(predicate, Predicate) and stl.signals(predicate):
            size = scale(predicate, box)
            yield _Quantity(predicate, size.near, size.far)
            for argument in _arguments((predicate.left, predicate.right)):
                far = reach(argument, box)
                yield _Quantity(argument, min(size.near, far), far)


def _arguments(expressions: Iterable[Expression]) -> Iterator[Expression]:
    """The arguments of norms and absolute values, which have a sign."""
    for expression in expressions:
        match expression:
            case Call(name, args) if name in _INSIDE:
                yield from args
            case Call("min" | "max", args):
                yield from _arguments(args)
            case Binary(_, left, right):
                yield from _arguments((left, right))
            case Negative(arg):
                yield from _arguments((arg,))


def _directions(quantities: Sequence[_Quantity]) -> Sequence[_Quantity]:
    """The arguments of norms, else the margins."""
    return [each for each in quantities if not isinstance(each.source, Predicate)] or quantities


def _table(rows: Sequence[Sequence[int]], empty: int) -> Integers:
    """Rows of the same length, filled up with `empty`."""
    width = max(map(len, rows), default=0)
    return np.array([[*row, *[empty] * (width - len(row))] for row in rows], dtype=np.int64)


def _squashed(values: Array) -> Array:
    """About the value near 0, and within (-1, 1)."""
    squashed: Array = values / np.sqrt(1.0 + values**2)
    return squashed
