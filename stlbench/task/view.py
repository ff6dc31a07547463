"""The formula's view: what a policy observes beside the state, from the formula and the ranges of the signals alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers
from stlbench.stl import Binary, Call, Expression, Formula, Negative, Predicate
from stlbench.stl.language.structure import walk
from stlbench.task.scales import Box, reach, scale
from stlbench.task.windows import Window, windows

FEW_WINDOWS = 6
"""With at most so many windows, a policy sees the quantities of all of them at all times."""
MOST_FEATURES = 64
"""Of an environment with more numbers than this, such as pictures, no products with directions are shown."""
_INSIDE = frozenset({"norm", "norminf", "abs", "hypot"})


@dataclass(frozen=True)
class _Quantity:
    """A margin of a predicate, or an argument of a norm or an absolute value inside of one."""

    source: Predicate | Expression
    near: float
    far: float

    @property
    def factors(self) -> tuple[float, ...]:
        """The sizes at which it is shown, largest first: one to three."""
        sizes = [self.far]
        if self.far > 30 * self.near:
            sizes.append(float(np.sqrt(self.near * self.far)))
        if self.near < 0.9 * self.far:
            sizes.append(self.near)
        return tuple(sizes)

    def __str__(self) -> str:
        return f"margin of {self.source}" if isinstance(self.source, Predicate) else str(self.source)


class FormulaView:
    """What follows the state in an observation on the track `auto`. It serves every system and environment.

    The windows of the formula are the invariants and the rest, the goals, by deadline. The view shows, in this order:

    - each quantity of the invariants, and of the goals where there are few. A quantity is the margin of a predicate or
      an argument of a norm in it, which is a direction. It is shown over its range, and squashed at its near size;
    - where there is more than one goal, the quantities of the next goal, always in the same columns, and which goal
      is next. So a network treats all goals alike;
    - the time until the next goal's window begins and ends, at two sizes;
    - the products of the state's numbers with the directions of the next goal.

    The number of columns grows linearly with the formula. All functions are exactly rounded, so that every processor
    computes the same bits.
    """

    def __init__(self, formula: Formula, box: Box, steps: int) -> None:
        """Args: `formula` with intervals in steps, `box` the ranges of the signals, `steps` T of the task."""
        found = windows(formula)
        invariants = [window for window in found if window.invariant]
        self.goals = sorted((window for window in found if not window.invariant), key=lambda w: (w.end, w.begin))
        quantities = {window: tuple(dict.fromkeys(_quantities(window, box))) for window in found}
        shown = found if len(self.goals) <= FEW_WINDOWS else invariants
        self._all = tuple(dict.fromkeys(each for window in found for each in quantities[window]))
        places = {quantity: place for place, quantity in enumerate(self._all)}
        self._evaluate = _evaluator([quantity.source for quantity in self._all], tuple(box))

        columns = [(place, size) for place, quantity in enumerate(self._all) for size in quantity.factors]
        self._places = np.array([place for place, _ in columns], dtype=np.int64)
        self._sizes = np.array([size for _, size in columns])
        self._ranged = np.array([size == self._all[place].far for place, size in columns])
        of_quantity = {
            quantity: [column for column, (place, _) in enumerate(columns) if place == places[quantity]]
            for quantity in self._all
        }
        visible = dict.fromkeys(quantity for window in shown for quantity in quantities[window])
        self._shown = np.array([column for quantity in visible for column in of_quantity[quantity]], dtype=np.int64)

        ends = np.array([goal.end for goal in self.goals], dtype=np.int64)
        times = np.arange(steps + 1)
        self._next = np.minimum(np.searchsorted(ends, times), max(len(ends) - 1, 0))
        slots = [[c for quantity in quantities[goal] for c in of_quantity[quantity]] for goal in self.goals]
        self._slots = _table(slots, len(columns)) if len(self.goals) > 1 else np.empty((1, 0), dtype=np.int64)
        self._clock = self._clocks(times, steps)

        towards = self.goals or invariants[:1]
        directions = [[places[each] for each in _directions(quantities[window])] for window in towards]
        self._directions = _table(directions, len(self._all))
        near = [self._all[place].near for row in directions for place in row]
        self._near = min(near, default=1.0)

    @property
    def quantities(self) -> tuple[str, ...]:
        """What is shown, for people."""
        return tuple(map(str, self._all))

    def __call__(self, state: Array, signals: Array, t: Integers) -> Array:
        """The columns of N copies: the state's numbers (N, d), signals (N, k), steps t (N,) in 0..T -> (N, v)."""
        values = self._evaluate(signals)
        ratios = values[:, self._places] / self._sizes
        columns = np.where(self._ranged, ratios.clip(-1.0, 1.0), _squashed(ratios))
        upcoming = self._next[t]
        slot = _with_zero(columns)[np.arange(len(t))[:, None], self._slots[upcoming if len(self._slots) > 1 else 0]]
        parts = [columns[:, self._shown], slot.reshape(len(t), -1), self._clock[t]]
        if 0 < state.shape[1] <= MOST_FEATURES:
            row = self._directions[upcoming if len(self._directions) > 1 else np.zeros(len(t), dtype=np.int64)]
            vector = _with_zero(values)[np.arange(len(t))[:, None], row]
            length = np.sqrt((vector**2).sum(axis=1, keepdims=True))
            unit = vector / np.maximum(length, 1e-9) * _squashed(length / self._near)
            parts.append((state[:, :, None] * unit[:, None, :]).reshape(len(t), -1))
        return np.concatenate(parts, axis=1)

    def _clocks(self, times: Integers, steps: int) -> Array:
        """Which goal is next, and the time until its window begins and ends, at each step: (T + 1, columns)."""
        columns: list[Array] = []
        if len(self.goals) > 1:
            columns += [np.where(self._next == goal, 1.0, -1.0) for goal in range(len(self.goals))]
        if self.goals:
            edges = np.array([(goal.begin, goal.end) for goal in self.goals])[self._next]
            left = (edges - times[:, None]) / steps
            columns += [*_squashed(left / 0.25).T, *_squashed(left / 0.03).T]
        return np.stack(columns, axis=1) if columns else np.empty((len(times), 0))


def _quantities(window: Window, box: Box) -> Iterator[_Quantity]:
    for predicate in walk(window.psi):
        if isinstance(predicate, Predicate):
            size = scale(predicate, box)
            yield _Quantity(predicate, size.near, size.far)
            for argument in dict.fromkeys(_arguments((predicate.left, predicate.right))):
                far = reach(argument, box)
                yield _Quantity(argument, min(size.near, far), far)


def _arguments(expressions: Iterable[Expression]) -> Iterator[Expression]:
    """What norms and absolute values are taken of, which has a sign."""
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


def _directions(quantities: tuple[_Quantity, ...]) -> tuple[_Quantity, ...]:
    """The arguments of norms, else the margins."""
    arguments = tuple(each for each in quantities if not isinstance(each.source, Predicate))
    return arguments or quantities


def _evaluator(sources: Iterable[Predicate | Expression], names: tuple[str, ...]) -> Callable[[Array], Array]:
    """A function of samples (N, k) to the values (N, q) of predicates' margins and of expressions."""
    functions = [
        stl.margin(source if isinstance(source, Predicate) else Predicate(">=", source, stl.Number(0.0)), names)
        for source in sources
    ]
    return lambda samples: np.stack([function(samples) for function in functions], axis=1)


def _table(rows: list[list[int]], empty: int) -> Integers:
    """Rows of the same length, filled up with `empty`."""
    width = max(map(len, rows), default=0)
    return np.array([[*row, *[empty] * (width - len(row))] for row in rows] or [[]], dtype=np.int64)


def _with_zero(columns: Array) -> Array:
    """The columns, and one of zeros, which empty places of a table refer to."""
    return np.concatenate([columns, np.zeros((len(columns), 1))], axis=1)


def _squashed(values: Array) -> Array:
    """About the value near 0, and within (-1, 1)."""
    squashed: Array = values / np.sqrt(1.0 + values**2)
    return squashed
