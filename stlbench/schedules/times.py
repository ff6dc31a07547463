"""The steps of a plan: a linear programme, and a search over the order of what excludes each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, Integers
from stlbench.schedules.plan import At, Event, Held, Plan
from stlbench.schedules.regions import Regions

MOST_NODES = 300
"""Linear programmes that are solved for one plan. If they do not suffice, as many again try to improve the order."""
MOST_PACE = 1e4
"""The pace of a plan in which nothing has a distance, as no way limits it."""
_TOLERANCE = 1e-6
_FAST = 1.6
"""A robot may be so many times as fast as the pace, and still need not wait before a goal."""
_HELD_COST = 0.5
"""A held step costs this share of what a step in the width of a window is worth."""

_EARLY = 1e-5
"""The cost of a step later. The earliest of equally wide windows count, whatever the solver prefers."""

_Item = Event | Held
Flags = NDArray[np.bool_]


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


@dataclass(frozen=True)
class _Rows:
    """Rows as arrays (n,): x[earlier] + pace * distance <= x[later] + room.

    In place of a number there is the variable -1, the last one, which is 0.
    """

    earlier: Integers
    later: Integers
    room: Array
    distance: Array
    soft: Flags
    """Whether a row has a gap or a distance: it may be broken to say by how much windows are too near."""

    @classmethod
    def of(cls, rows: Sequence[_Row]) -> _Rows:
        ends = [[-1 if at.variable is None else at.variable for at in (row.earlier, row.later)] for row in rows]
        earlier, later = np.array(ends, dtype=np.int64).reshape(-1, 2).T
        room = [row.later.offset - row.earlier.offset - row.gap for row in rows]
        distance = [row.distance for row in rows]
        soft = [bool(row.gap or row.distance) for row in rows]
        left, far = (np.array(each, dtype=float) for each in (room, distance))
        return cls(earlier, later, left, far, np.array(soft, dtype=bool))

    def left(self, values: Array, pace: float) -> Array:
        """The steps that each row leaves free (n,); negative where it is broken."""
        free: Array = self.room + values[self.later] - values[self.earlier] - pace * self.distance
        return free

    def between(self) -> Iterator[tuple[At, At, int]]:
        """The rows at pace 0: an earlier step, a later one, and the steps that are between them at least."""
        ends = ([At(0, None if place < 0 else place) for place in side.tolist()] for side in (self.earlier, self.later))
        yield from zip(*ends, (-self.room).round().astype(int).tolist(), strict=True)

    @classmethod
    def joined(cls, parts: Sequence[_Rows]) -> _Rows:
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@dataclass(frozen=True)
class _Point:
    """Values of the variables (n + 1,), of which the last is 0 and stands in for numbers; and a pace."""

    values: Array
    pace: float

    def at(self, step: At) -> float:
        return step.offset + (0.0 if step.variable is None else float(self.values[step.variable]))

    def middle(self, item: _Item) -> float:
        return self.at(item.begin) + self.at(item.end)


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
        self.items: tuple[_Item, ...] = (*plan.events, *plan.held)
        rows = [_Row(earlier, later) for earlier, later in plan.rows]
        rows += [_Row(event.begin, event.end, hold) for event in plan.events]
        self.rows = _Rows.of([*rows, *(row for item in self.items for row in self._arrival(item))])

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Items that exclude each other."""
        pairs = combinations(range(len(self.items)), 2)
        return [(i, j) for i, j in pairs if self._regions.exclusive(self.items[i].psi, self.items[j].psi)]

    @cached_property
    def ways(self) -> list[_Rows]:
        """Both orders of each pair, one after the other: 2 k is the first item of pair k before the second."""
        items = [(self.items[i], self.items[j]) for i, j in self.pairs]
        return [_Rows.of(self._apart(*each)) for pair in items for each in (pair, pair[::-1])]

    @cached_property
    def _all_ways(self) -> tuple[_Rows, Integers]:
        """The rows of all ways, and where those of each begin."""
        counts = [len(way.room) for way in self.ways]
        return _Rows.joined(self.ways), np.cumsum([0, *counts[:-1]])

    def _arrival(self, item: _Item) -> list[_Row]:
        """The way from the start to an item."""
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
    def _free(self) -> _Point | None:
        """The solution without any order."""
        return self._fastest(())

    @property
    def bound(self) -> float | None:
        """The greatest pace of any order, or more; None where no order has times."""
        return None if self._free is None else self._free.pace

    def best(self, share: float = 1.0) -> Times | None:
        """The widest windows at the greatest pace, or at a share of it; None where all exclude each other."""
        self.nodes = 0
        possible = self._possible()
        if self._free is None or not possible.reshape(-1, 2).any(axis=1).all():
            return None
        found, bound = None, -1.0
        pending: list[tuple[int, ...]] = [()]
        while pending and self.nodes < MOST_NODES:
            self.nodes += 1
            order = pending.pop()
            solved = self._fastest(order) if order else self._free
            if solved is None or solved.pace <= bound + _TOLERANCE:
                continue
            clash = self._clash(solved, order)
            if clash is None:
                bound, found = solved.pace, self._complete(order, solved)
                continue
            first, second = (solved.middle(self.items[item]) for item in self.pairs[clash])
            ways = (2 * clash + 1, 2 * clash)  # the likelier order comes last, and is tried first
            pending += [(*order, way) for way in (ways[::-1] if first > second else ways) if possible[way]]
        if found is not None and pending:
            found = self._rearranged(found, bound, possible)
        return None if found is None else self._settled(found, share)

    def _possible(self) -> Flags:
        """Whether the rows leave room for each way, at any pace."""
        count = self.plan.variables + 1
        longest = np.full((count, count), -np.inf)
        longest[-1] = 0.0  # the last one stands for 0, and no variable is below it
        np.fill_diagonal(longest, 0.0)
        np.maximum.at(longest, (self.rows.earlier, self.rows.later), -self.rows.room)
        for middle in range(count):
            np.maximum(longest, longest[:, middle, None] + longest[middle], out=longest)
        if not self.pairs:
            return np.zeros(0, dtype=bool)
        rows, starts = self._all_ways
        return np.logical_and.reduceat(longest[rows.later, rows.earlier] - rows.room <= _TOLERANCE, starts)

    def _rearranged(self, order: tuple[int, ...], bound: float, possible: Flags) -> tuple[int, ...]:
        """A complete order made better by small changes, those first that shorten the whole way most."""
        left, solved = MOST_NODES, self._fastest(order)
        while solved is not None:
            middles = list(map(solved.middle, self.items))
            sequence = sorted(range(len(self.items)), key=middles.__getitem__)
            order, solved, better = self._complete((), solved), None, bound + _TOLERANCE
            for moved in sorted(_moved(sequence), key=self._length)[:left]:
                candidate = self._order(moved)
                if candidate != order and possible[list(candidate)].all():
                    self.nodes, left = self.nodes + 1, left - 1
                    found = self._fastest(candidate)
                    if found is not None and found.pace > better:
                        order, bound, solved = candidate, found.pace, found
                        break
        return order

    def _order(self, sequence: Sequence[int]) -> tuple[int, ...]:
        """The order of all pairs, where the items come in a sequence."""
        rank = {item: number for number, item in enumerate(sequence)}
        return tuple(2 * pair + (rank[i] > rank[j]) for pair, (i, j) in enumerate(self.pairs))

    def _length(self, sequence: Sequence[int]) -> float:
        """The way from the start to all items in a sequence."""
        targets = [self.items[item].psi for item in sequence]
        return sum(map(self._regions.distance, [None, *targets[:-1]], targets))

    def shortfall(self) -> str | None:
        """The two items that are too near each other, with their windows and the steps that are missing.

        None where the windows leave no room, whatever excludes what.
        """
        free = self._free
        if free is None or not self.pairs:
            return None
        middles = [[free.middle(self.items[item]) for item in pair] for pair in self.pairs]
        order = [2 * k + (first > second) for k, (first, second) in enumerate(middles)]
        solved = self._fastest(order, elastic=True)
        if solved is None:
            return None
        over = [float(-self.ways[way].left(solved.values, 0.0).min()) for way in order]
        worst = int(np.argmax(over))
        if over[worst] <= 0:
            return None
        i, j = self.pairs[worst]
        first, second = (self._told(free, item) for item in ((i, j) if order[worst] % 2 == 0 else (j, i)))
        return f"{first} and {second} exclude each other; steps missing: {max(1, round(over[worst]))}"

    def _told(self, solved: _Point, item: int) -> str:
        each = self.items[item]
        begin, end = (round(solved.at(step)) for step in (each.begin, each.end))
        return f"{each.psi} in {begin}..{end}"

    def _settled(self, order: tuple[int, ...], share: float) -> Times:
        """The widest windows at this pace, in whole steps.

        Rounding down keeps rows between whole numbers, as they are differences. A way may lose a part of a step. The
        order is complete: wider windows must not overlap where the narrow ones did not.
        """
        solved = self._fastest(order)
        assert solved is not None
        early = self._early(solved)
        if early and (earlier := self._fastest(order, early)) is not None:
            solved = earlier
        else:
            early = []
        pace = solved.pace
        widest = self._widest(self._with(order, early), pace, share) or solved  # None by rounding errors
        values = np.floor(widest.values[:-1] + _TOLERANCE).astype(int)
        return Times(max(0.0, pace), tuple(values.tolist()))

    def _early(self, solved: _Point) -> list[_Row]:
        """Rows by which exclusions before an event end so soon that a robot of `_FAST` times the pace need not wait.

        A method pays for being near a goal at once, so a robot arrives as soon as it can. It does not learn to wait.
        """
        rows = list[_Row]()
        for i, j in self.pairs:
            event, held = self.items[i], self.items[j]
            if not isinstance(event, Event) or not isinstance(held, Held):
                continue
            if held.end.variable is None or solved.at(held.end) >= solved.at(event.begin):
                continue
            over, origin = At(0), None
            for other in self.plan.events:
                if solved.at(over) < solved.at(other.end) <= solved.at(event.begin) and other is not event:
                    over, origin = other.end + other.stay, other.psi
            if (distance := self._regions.distance(origin, event.psi)) > 0:
                rows.append(_Row(held.end, over, 1, -distance / _FAST))
        return rows

    def _clash(self, solved: _Point, order: Sequence[int]) -> int | None:
        """The first pair whose order is open and that would be at the same time, or too near."""
        open_pairs = np.flatnonzero(self._open(order) & ~self._are_apart(solved).any(axis=1))
        return int(open_pairs[0]) if len(open_pairs) else None

    def _complete(self, order: tuple[int, ...], solved: _Point) -> tuple[int, ...]:
        """The order of all pairs: open ones are added as they are apart in a solution."""
        rest = np.flatnonzero(self._open(order))
        return (*order, *(2 * rest + ~self._are_apart(solved)[rest, 0]).tolist())

    def _open(self, order: Sequence[int]) -> Flags:
        """Whether the order of each pair is open."""
        found = np.ones(len(self.pairs), dtype=bool)
        found[np.array(order, dtype=np.int64) // 2] = False
        return found

    def _are_apart(self, solved: _Point) -> Flags:
        """Whether the items of each pair are apart in a solution, in the one order and in the other (n, 2)."""
        if not self.pairs:
            return np.ones((0, 2), dtype=bool)
        rows, starts = self._all_ways
        kept = rows.left(solved.values, solved.pace) >= -1e-5  # wider than the solver's own tolerance, 1e-7 a row
        return np.logical_and.reduceat(kept, starts).reshape(-1, 2)

    def _with(self, order: Sequence[int], further: Sequence[_Row] = ()) -> _Rows:
        return _Rows.joined([self.rows, _Rows.of(further), *(self.ways[way] for way in order)])

    def _fastest(self, order: Sequence[int], further: Sequence[_Row] = (), elastic: bool = False) -> _Point | None:
        """The greatest pace, and steps for it.

        `elastic`: with the least number in place of the pace by which rows with a gap or a distance may be broken.
        """
        rows = self._with(order, further)
        if elastic:
            rows = replace(rows, distance=np.where(rows.soft, -1.0, 0.0))
        cost = np.zeros(self.plan.variables + 1)
        cost[-1] = 1.0 if elastic else -1.0
        return _solved(rows, cost, 0.0)

    def _widest(self, rows: _Rows, pace: float, share: float) -> _Point | None:
        """The widest windows at a pace."""
        if share < 1:
            return self._roomy(replace(rows, room=rows.room - share * pace * rows.distance, distance=0 * rows.distance))
        return _solved(rows, self.narrow, pace * (1 - _TOLERANCE))

    @property
    def narrow(self) -> Array:
        """The cost of narrow windows, of what is held for long, and of what is late."""
        cost = np.append(_EARLY * np.linspace(1, 2, self.plan.variables), 0.0)  # no two variables cost the same
        for item in self.items:
            factor = -1.0 if isinstance(item, Event) else _HELD_COST
            for step, more in ((item.end, factor), (item.begin, -factor)):
                if step.variable is not None:
                    cost[step.variable] += more
        return cost

    def _roomy(self, rows: _Rows) -> _Point | None:
        """Windows of which the narrowest is as wide as possible, in the middle of where they may be."""
        alike = _Rows.joined([rows, _Rows.of([_Row(each.begin, each.end, 0, 1.0) for each in self.plan.events])])
        least = _solved(alike, np.append(np.zeros(self.plan.variables), -1.0), 0.0)
        widest = None if least is None else _solved(alike, self.narrow, least.pace * (1 - _TOLERANCE))
        if widest is None:
            return None
        widths = [
            _Row(each.begin, each.end, int(widest.at(each.end) - widest.at(each.begin))) for each in self.plan.events
        ]
        kept, later = _Rows.joined([rows, _Rows.of(widths)]), np.append(np.ones(self.plan.variables), 0.0)
        found = [solved.values for cost in (later, -later) if (solved := _solved(kept, cost, 0.0)) is not None]
        return _Point(np.mean(found or [widest.values], axis=0), 0.0)


def _moved(sequence: Sequence[int]) -> Iterator[list[int]]:
    """The sequences with one item at another place, or with some neighbours the other way round."""
    items = list(sequence)
    for place in range(len(items)):
        rest = [*items[:place], *items[place + 1 :]]
        yield from ([*rest[:other], items[place], *rest[other:]] for other in range(len(items)))
    for begin, end in combinations(range(len(items) + 1), 2):
        yield [*items[:begin], *items[begin:end][::-1], *items[end:]]


def _solved(rows: _Rows, cost: Array, least: float) -> _Point | None:
    """The point of least cost whose pace is at least `least`; None where there is none."""
    from scipy.optimize import linprog  # which most commands do without
    from scipy.sparse import coo_array

    count, variables = len(rows.room), len(cost) - 1
    place = np.arange(count)
    data = np.concatenate([np.ones(count), -np.ones(count), rows.distance])
    column = np.concatenate([rows.earlier, rows.later, np.full(count, variables)])
    used = (column >= 0) & (data != 0)
    index = (np.tile(place, 3)[used], column[used])
    left: Any = coo_array((data[used], index), shape=(count, variables + 1)).tocsr()
    left.eliminate_zeros()
    bounds = [(0.0, None)] * variables + [(max(0.0, least), MOST_PACE)]
    solved: Any = linprog(cost, A_ub=left, b_ub=rows.room, bounds=bounds, method="highs")
    return _Point(np.append(solved.x[:-1], 0.0), float(solved.x[-1])) if solved.status == 0 else None
