"""The steps of a plan: a linear programme, and a search over the order of what excludes each other."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from stlbench.contract import Integers
from stlbench.schedules.plan import At, Event, Held, Plan
from stlbench.schedules.regions import Regions
from stlbench.schedules.rows import MOST_PACE, TOLERANCE, Flags, Point, Row, Rows, add, binding_for, solved_for

MOST_NODES = 300
"""Linear programmes that are solved for one plan. Where they do not suffice, as many again try to improve the order."""
_FAST = 1.6
"""So many times the pace a robot may have without having to wait for what is excluded before a goal."""
_LENGTH = 0.5
"""Of what is held, a step costs so much of what a step in the width of a window is worth."""
_WORTH = 1.1
"""Windows are moved where a way gets so many times the steps that it had."""

_Item = Event | Held


@dataclass(frozen=True)
class Times:
    """Values of a plan's variables, and the pace: the steps for a unit of distance that every way has at least."""

    pace: float
    values: tuple[int, ...]


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
        rows = [Row(earlier, later) for earlier, later in plan.rows]
        rows += [Row(event.begin, event.end, hold) for event in plan.events]
        self._rows = Rows.of([*rows, *(row for item in self._items for row in self._arrival(item))])

    @cached_property
    def _pairs(self) -> list[tuple[int, int]]:
        """Items that exclude each other."""
        pairs = combinations(range(len(self._items)), 2)
        return [(i, j) for i, j in pairs if self._regions.exclusive(self._items[i].psi, self._items[j].psi)]

    @cached_property
    def _ways(self) -> list[Rows]:
        """Of each pair both orders, one after the other: 2 k is the first item of pair k before the second."""
        items = [(self._items[i], self._items[j]) for i, j in self._pairs]
        return [Rows.of(self._apart(*each)) for pair in items for each in (pair, pair[::-1])]

    @cached_property
    def _all_ways(self) -> tuple[Rows, Integers]:
        """The rows of all ways, and where those of each begin."""
        counts = [len(way.room) for way in self._ways]
        return Rows.joined(self._ways), np.cumsum([0, *counts[:-1]])

    def _arrival(self, item: _Item) -> list[Row]:
        """From the start to an item."""
        distance = self._regions.distance(None, item.psi)
        if distance == 0:
            return []
        if isinstance(item, Held):
            return [Row(At(0), item.begin, 0, distance)]
        return [Row(At(0), item.end, self._hold, distance)]

    def _apart(self, first: _Item, second: _Item) -> list[Row]:
        """The first item is over before the second one begins, and there is time for the way."""
        over = first.end + (first.stay if isinstance(first, Event) else 0)
        distance = self._regions.distance(first.psi, second.psi)
        if isinstance(second, Held):
            return [Row(over, second.begin, 1, distance)]
        if isinstance(first, Held):
            return [Row(over, second.begin, 1), Row(over, second.end, self._hold, distance)]
        return [Row(over, second.begin), Row(over, second.end, self._hold, distance)]

    @cached_property
    def _free(self) -> Point | None:
        """The solution without any order."""
        return self._fastest(())

    @property
    def bound(self) -> float | None:
        """The greatest pace of any order, or more; None where no order has times."""
        return None if self._free is None else self._free.pace

    def best(self) -> Times | None:
        """The times of the greatest pace; None where all exclude each other."""
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
            if solved is None or solved.pace <= bound + TOLERANCE:
                continue
            clash = self._clash(solved, order)
            if clash is None:
                bound, found = solved.pace, self._complete(order, solved)
                continue
            first, second = (solved.middle(self._items[item]) for item in self._pairs[clash])
            ways = (2 * clash + 1, 2 * clash)  # the likelier order comes last, and is tried first
            pending += [(*order, way) for way in (ways[::-1] if first > second else ways) if possible[way]]
        if found is not None and pending:
            found = self._rearranged(found, bound, possible)
        return None if found is None else self._settled(found)

    def _possible(self) -> Flags:
        """Of each way, whether the rows leave room for it at any pace."""
        count = self.plan.variables + 1
        longest = np.full((count, count), -np.inf)
        longest[-1] = 0.0  # no variable is below 0
        np.fill_diagonal(longest, 0.0)
        np.maximum.at(longest, (self._rows.earlier, self._rows.later), -self._rows.room)
        for middle in range(count):
            np.maximum(longest, longest[:, middle, None] + longest[middle], out=longest)
        if not self._pairs:
            return np.zeros(0, dtype=bool)
        rows, starts = self._all_ways
        return np.logical_and.reduceat(longest[rows.later, rows.earlier] - rows.room <= TOLERANCE, starts)

    def _rearranged(self, order: tuple[int, ...], bound: float, possible: Flags) -> tuple[int, ...]:
        """A complete order made better by small changes, those first that shorten the whole way most."""
        left, solved = MOST_NODES, self._fastest(order)
        while solved is not None:
            middles = list(map(solved.middle, self._items))
            sequence = sorted(range(len(self._items)), key=middles.__getitem__)
            order, solved, better = self._complete((), solved), None, bound + TOLERANCE
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
        return tuple(2 * pair + (rank[i] > rank[j]) for pair, (i, j) in enumerate(self._pairs))

    def _length(self, sequence: Sequence[int]) -> float:
        """The way from the start to all items in a sequence."""
        targets = [self._items[item].psi for item in sequence]
        return sum(map(self._regions.distance, [None, *targets[:-1]], targets))

    def shortfall(self) -> str | None:
        """The two items that are too near each other, with their windows and the steps that are missing.

        None where the windows leave no room, whatever excludes what.
        """
        free = self._free
        if free is None or not self._pairs:
            return None
        middles = [[free.middle(self._items[item]) for item in pair] for pair in self._pairs]
        order = [2 * k + (first > second) for k, (first, second) in enumerate(middles)]
        solved = self._fastest(order, elastic=True)
        if solved is None:
            return None
        over = [float(-self._ways[way].left(solved.values, 0.0).min()) for way in order]
        worst = int(np.argmax(over))
        if over[worst] <= 0:
            return None
        i, j = self._pairs[worst]
        first, second = (self._told(free, item) for item in ((i, j) if order[worst] % 2 == 0 else (j, i)))
        return f"{first} and {second} exclude each other; steps missing: {max(1, round(over[worst]))}"

    def _told(self, solved: Point, item: int) -> str:
        each = self._items[item]
        begin, end = (round(solved.at(step)) for step in (each.begin, each.end))
        return f"{each.psi} in {begin}..{end}"

    def _settled(self, order: tuple[int, ...]) -> Times:
        """With the widest windows at this pace, in whole steps: rows are differences, so rounding down keeps them.

        The order is complete: wider windows must not overlap where the narrow ones did not.
        """
        solved = self._fastest(order)
        assert solved is not None
        early = self._early(solved)
        if early and (earlier := self._fastest(order, early)) is not None:
            solved = earlier
        else:
            early = []
        pace = solved.pace
        widest = self._widest(order, early, pace) or solved  # None by rounding errors
        balanced = self._balanced(order, early, widest)
        values = np.floor(balanced.values[:-1] + TOLERANCE).astype(int)
        return Times(max(0.0, pace), tuple(values.tolist()))

    def _early(self, solved: Point) -> list[Row]:
        """What is excluded until an event ends so soon that a robot of `_FAST` times the pace need not wait for it.

        A method pays for being near a goal at once, so a robot arrives as soon as it can. It does not learn to wait.
        """
        rows = list[Row]()
        for i, j in self._pairs:
            event, held = self._items[i], self._items[j]
            if not isinstance(event, Event) or not isinstance(held, Held):
                continue
            if held.end.variable is None or solved.at(held.end) >= solved.at(event.begin):
                continue
            over, origin = At(0), None
            for other in self.plan.events:
                if solved.at(over) < solved.at(other.end) <= solved.at(event.begin) and other is not event:
                    over, origin = other.end + other.stay, other.psi
            if (distance := self._regions.distance(origin, event.psi)) > 0:
                rows.append(Row(held.end, over, 1, -distance / _FAST))
        return rows

    def _clash(self, solved: Point, order: Sequence[int]) -> int | None:
        """The first pair whose order is open and that would be at the same time, or too near."""
        open_pairs = np.flatnonzero(self._open(order) & ~self._are_apart(solved).any(axis=1))
        return int(open_pairs[0]) if len(open_pairs) else None

    def _complete(self, order: tuple[int, ...], solved: Point) -> tuple[int, ...]:
        """With the pairs whose order is open, as they are apart in a solution."""
        rest = np.flatnonzero(self._open(order))
        return (*order, *(2 * rest + ~self._are_apart(solved)[rest, 0]).tolist())

    def _open(self, order: Sequence[int]) -> Flags:
        """Of each pair, whether its order is not decided."""
        found = np.ones(len(self._pairs), dtype=bool)
        found[np.array(order, dtype=np.int64) // 2] = False
        return found

    def _are_apart(self, solved: Point) -> Flags:
        """Of each pair, whether its items are apart in a solution, in the one order and in the other (n, 2)."""
        if not self._pairs:
            return np.ones((0, 2), dtype=bool)
        rows, starts = self._all_ways
        kept = rows.left(solved.values, solved.pace) >= -1e-5
        return np.logical_and.reduceat(kept, starts).reshape(-1, 2)

    def _with(self, order: Sequence[int], further: Sequence[Row] = ()) -> Rows:
        return Rows.joined([self._rows, Rows.of(further), *(self._ways[way] for way in order)])

    def _fastest(self, order: Sequence[int], further: Sequence[Row] = (), elastic: bool = False) -> Point | None:
        """The greatest pace, and steps for it.

        `elastic`: with the least number in place of the pace by which rows with a gap or a distance may be broken.
        """
        rows = self._with(order, further)
        if elastic:
            rows = replace(rows, distance=np.where(rows.soft, -1.0, 0.0))
        cost = np.zeros(self.plan.variables + 1)
        cost[-1] = 1.0 if elastic else -1.0
        return solved_for(rows, cost, 0.0)

    def _balanced(self, order: Sequence[int], further: Sequence[Row], point: Point) -> Point:
        """With windows of the same widths, moved so that each way has as much time as it can, the shortest first."""
        kept = [
            Row(item.begin, item.end, width) if isinstance(item, Event) else Row(item.end, item.begin, -width)
            for item in self._items
            for width in [point.width(item)]
        ]
        rows = self._with(order, [*further, *kept])
        ways = rows.distance > 0
        before, moved, fixed = rows.left(point.values, 0.0)[ways], point, ~ways
        while not fixed.all():
            moving = replace(rows, distance=np.where(fixed, 0.0, rows.distance))
            cost = np.zeros(self.plan.variables + 1)
            cost[-1] = -1.0
            solved, binding = binding_for(moving, cost)
            if solved is None or solved.pace >= MOST_PACE:
                break
            moved = Point(solved.values, point.pace)
            tight = binding & ~fixed
            if not tight.any():
                break
            room = np.where(tight, rows.room - solved.pace * rows.distance, rows.room)
            rows, fixed = replace(rows, room=room), fixed | tight
        after = self._with(order, [*further, *kept]).left(moved.values, 0.0)[ways]
        return moved if np.any(after >= _WORTH * before + 1) else point

    def _widest(self, order: Sequence[int], further: Sequence[Row], pace: float) -> Point | None:
        """The widest windows at a pace."""
        cost = np.zeros(self.plan.variables + 1)
        for event in self.plan.events:
            add(cost, event.begin, 1.0)
            add(cost, event.end, -1.0)
        for held in self.plan.held:
            add(cost, held.begin, -_LENGTH)
            add(cost, held.end, _LENGTH)
        return solved_for(self._with(order, further), cost, pace * (1 - TOLERANCE))


def _moved(sequence: Sequence[int]) -> Iterator[list[int]]:
    """The sequences with one item at another place, or with some neighbours the other way round."""
    items = list(sequence)
    for place in range(len(items)):
        rest = [*items[:place], *items[place + 1 :]]
        yield from ([*rest[:other], items[place], *rest[other:]] for other in range(len(items)))
    for begin, end in combinations(range(len(items) + 1), 2):
        yield [*items[:begin], *items[begin:end][::-1], *items[end:]]
