"""The steps of a plan: a linear programme, and a search over the order of what excludes each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from stlbench.contract import Array
from stlbench.schedules.plan import At, Event, Held, Plan
from stlbench.schedules.regions import Regions

MOST_NODES = 300
"""Linear programmes that are solved for one plan."""
MOST_PACE = 1e4
"""Where nothing has a distance, so that no way limits the pace."""
_TOLERANCE = 1e-6
_FAST = 1.6
"""So many times the pace a robot may have without having to wait for what is excluded before a goal."""
_LENGTH = 0.5
"""Of what is held, a step costs so much of what a step in the width of a window is worth."""

_Item = Event | Held


@dataclass(frozen=True)
class Times:
    """Values of a plan's variables, and the pace: the steps for a unit of distance that every way has at least."""

    pace: float
    values: tuple[int, ...]


@dataclass(frozen=True)
class _Row:
    """earlier + gap + pace * distance <= later."""

    earlier: At
    later: At
    gap: int = 0
    distance: float = 0.0


class Programme:
    """The linear programme of one plan.

    Args:
        plan: events, what is held, and rows.
        regions: distances.
        hold: steps for which an action is held, the least width of a window.
    """

    def __init__(self, plan: Plan, regions: Regions, hold: int) -> None:
        self.plan, self._regions, self._hold = plan, regions, hold
        self.nodes = 0
        self._items: tuple[_Item, ...] = (*plan.events, *plan.held)
        self._pairs = [
            (i, j)
            for i, j in combinations(range(len(self._items)), 2)
            if regions.exclusive(self._items[i].psi, self._items[j].psi)
        ]
        self._rows = [_Row(earlier, later) for earlier, later in plan.rows]
        self._rows += [_Row(event.begin, event.end, hold) for event in plan.events]
        self._rows += [row for item in self._items for row in self._arrival(item)]

    def _arrival(self, item: _Item) -> list[_Row]:
        """From the start to an item."""
        distance = self._regions.distance(None, item.psi)
        if distance == 0:
            return []
        if isinstance(item, Held):
            return [_Row(At(0), item.begin, 0, distance)]
        return [_Row(At(0), item.end, self._hold, distance)]

    def _apart(self, first: _Item, second: _Item) -> list[_Row]:
        """The first item is over before the second one begins, and there is time for the way."""
        over = first.end + (first.stay if isinstance(first, Event) else 0)
        distance = self._regions.distance(first.psi, second.psi)
        if isinstance(second, Held):
            return [_Row(over, second.begin, 1, distance)]
        if isinstance(first, Held):
            return [_Row(over, second.begin, 1), _Row(over, second.end, self._hold, distance)]
        return [_Row(over, second.begin), _Row(over, second.end, self._hold, distance)]

    @cached_property
    def _free(self) -> Array | None:
        """The solution without any order."""
        return self._solved(())

    @property
    def bound(self) -> float | None:
        """The greatest pace of any order, or more; None where no order has times."""
        return None if self._free is None else float(self._free[-1])

    def best(self) -> Times | None:
        """The times of the greatest pace; None where all exclude each other."""
        found, bound = None, -1.0
        pending: list[tuple[tuple[int, int], ...]] = [()]
        self.nodes = 0
        while pending and self.nodes < MOST_NODES:
            self.nodes += 1
            order = pending.pop()
            solved = self._solved(order) if order else self._free
            if solved is None or float(solved[-1]) <= bound + _TOLERANCE:
                continue
            clash = self._clash(solved, order)
            if clash is None:
                bound = float(solved[-1])
                found = order
                continue
            first, second = clash
            later = self._middle(solved, first) > self._middle(solved, second)
            branches = [(*order, (first, second)), (*order, (second, first))]
            pending += branches if later else branches[::-1]  # the likelier order comes last and is tried first
        return None if found is None else self._settled(found)

    def shortfall(self) -> str | None:
        """The two items that are too near each other, with their windows and the steps that are missing.

        None where the windows leave no room, whatever excludes what.
        """
        free = self._free
        if free is None:
            return None
        order = [(i, j) if self._middle(free, i) <= self._middle(free, j) else (j, i) for i, j in self._pairs]
        solved = self._solved(order, elastic=True)
        if solved is None:
            return None
        rows = [(row, pair) for pair in order for row in self._apart(self._items[pair[0]], self._items[pair[1]])]
        over = [_at(solved, row.earlier) + row.gap - _at(solved, row.later) for row, _ in rows]
        if not over or max(over) <= 0:
            return None
        worst = int(np.argmax(over))
        first, second = (self._told(free, item) for item in rows[worst][1])
        return f"{first} and {second} exclude each other; steps missing: {max(1, round(over[worst]))}"

    def _told(self, solved: Array, item: int) -> str:
        each = self._items[item]
        begin, end = (round(_at(solved, step)) for step in (each.begin, each.end))
        return f"{each.psi} in {begin}..{end}"

    def _settled(self, order: tuple[tuple[int, int], ...]) -> Times:
        """With the widest windows at this pace, in whole steps: rows are differences, so rounding down keeps them."""
        fastest = self._solved(order)
        assert fastest is not None
        order = self._complete(order, fastest)  # wider windows must not overlap where the narrow ones did not
        early = self._early(fastest)
        solved = self._solved(order, further=early) if early else fastest
        if solved is None:
            early, solved = [], fastest
        pace = float(solved[-1])
        widest = self._solved(order, pace * (1 - _TOLERANCE), early)
        solved = solved if widest is None else widest  # None by rounding errors
        values = np.floor(solved[:-1] + _TOLERANCE).astype(int)
        return Times(max(0.0, pace), tuple(values.tolist()))

    def _early(self, solved: Array) -> list[_Row]:
        """What is excluded until an event ends so soon that a robot of `_FAST` times the pace need not wait for it.

        A method pays for being near a goal at once, so a robot arrives as soon as it can. It does not learn to wait.
        """
        rows = list[_Row]()
        for i, j in self._pairs:
            event, held = self._items[i], self._items[j]
            if not isinstance(event, Event) or not isinstance(held, Held):
                continue
            if held.end.variable is None or _at(solved, held.end) >= _at(solved, event.begin):
                continue
            over, origin = At(0), None
            for other in self.plan.events:
                if _at(solved, over) < _at(solved, other.end) <= _at(solved, event.begin) and other is not event:
                    over, origin = other.end + other.stay, other.psi
            if (distance := self._regions.distance(origin, event.psi)) > 0:
                rows.append(_Row(held.end, over, 1, -distance / _FAST))
        return rows

    def _middle(self, solved: Array, item: int) -> float:
        each = self._items[item]
        return _at(solved, each.begin) + _at(solved, each.end)

    def _clash(self, solved: Array, order: Sequence[tuple[int, int]]) -> tuple[int, int] | None:
        """The first pair whose order is open and that would be at the same time, or too near."""
        for i, j in self._open(order):
            if not (self._are_apart(solved, i, j) or self._are_apart(solved, j, i)):
                return i, j
        return None

    def _complete(self, order: tuple[tuple[int, int], ...], solved: Array) -> tuple[tuple[int, int], ...]:
        """With the pairs whose order is open, as they are apart in a solution."""
        rest = self._open(order)
        return (*order, *((i, j) if self._are_apart(solved, i, j) else (j, i) for i, j in rest))

    def _open(self, order: Sequence[tuple[int, int]]) -> Iterator[tuple[int, int]]:
        """The pairs that exclude each other and whose order is not decided."""
        decided = {*order, *((j, i) for i, j in order)}
        return (pair for pair in self._pairs if pair not in decided)

    def _are_apart(self, solved: Array, first: int, second: int) -> bool:
        return all(self._kept(solved, row) for row in self._apart(self._items[first], self._items[second]))

    def _kept(self, solved: Array, row: _Row) -> bool:
        way = row.gap + float(solved[-1]) * row.distance
        return _at(solved, row.earlier) + way <= _at(solved, row.later) + 1e-5

    def _solved(
        self,
        order: Sequence[tuple[int, int]],
        pace: float | None = None,
        further: Sequence[_Row] = (),
        elastic: bool = False,
    ) -> Array | None:
        """The values of all variables and the pace, greatest; with a pace, the widest windows at it.

        `elastic`: with the least number in place of the pace by which rows with a gap may be broken.
        """
        from scipy.optimize import linprog  # which most commands do without

        rows = [*self._rows, *further] + [row for i, j in order for row in self._apart(self._items[i], self._items[j])]
        left = np.zeros((len(rows), self.plan.variables + 1))
        for place, row in enumerate(rows):
            _add(left[place], row.earlier, 1.0)
            _add(left[place], row.later, -1.0)
            left[place, -1] = row.distance if not elastic else -1.0 if row.gap or row.distance else 0.0
        right = np.array([row.later.offset - row.earlier.offset - row.gap for row in rows], dtype=np.float64)
        least = 0.0 if pace is None else max(0.0, pace)
        bounds = [(0.0, None)] * self.plan.variables + [(least, MOST_PACE)]
        cost = np.zeros(self.plan.variables + 1)
        if pace is None:
            cost[-1] = 1.0 if elastic else -1.0
        for event in () if pace is None else self.plan.events:
            _add(cost, event.begin, 1.0)
            _add(cost, event.end, -1.0)
        for held in () if pace is None else self.plan.held:
            _add(cost, held.begin, -_LENGTH)
            _add(cost, held.end, _LENGTH)
        solved = linprog(cost, A_ub=left, b_ub=right, bounds=bounds, method="highs")
        return np.asarray(solved.x, dtype=np.float64) if solved.status == 0 else None


def _add(row: Array, step: At, factor: float) -> None:
    """Add a multiple of a step to a row of coefficients, in place; its number has no coefficient."""
    if step.variable is not None:
        row[step.variable] += factor


def _at(solved: Array, step: At) -> float:
    return step.offset + (0.0 if step.variable is None else float(solved[step.variable]))
