"""Linear programmes over the steps of a plan and its pace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, Integers
from stlbench.schedules.plan import At, Event, Held

MOST_PACE = 1e4
"""Where nothing has a distance, so that no way limits the pace."""
TOLERANCE = 1e-6
"""Steps, and shares of a pace, below which two are the same."""

Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Row:
    """earlier + gap + pace * distance <= later."""

    earlier: At
    later: At
    gap: int = 0
    distance: float = 0.0


@dataclass(frozen=True)
class Rows:
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
    def of(cls, rows: Sequence[Row]) -> Rows:
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

    @classmethod
    def joined(cls, parts: Sequence[Rows]) -> Rows:
        names = [field.name for field in fields(cls)]
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@dataclass(frozen=True)
class Point:
    """Values of the variables (n + 1,), of which the last is 0 and stands in for numbers; and a pace."""

    values: Array
    pace: float

    def at(self, step: At) -> float:
        return step.offset + (0.0 if step.variable is None else float(self.values[step.variable]))

    def middle(self, item: Event | Held) -> float:
        return self.at(item.begin) + self.at(item.end)

    def width(self, item: Event | Held) -> int:
        """The whole steps from its begin to its end."""
        return int(np.floor(self.at(item.end) - self.at(item.begin) + TOLERANCE))


def solved_for(rows: Rows, cost: Array, least: float) -> Point | None:
    """The point of least cost whose pace is at least `least`; None where there is none."""
    return binding_for(rows, cost, least)[0]


def binding_for(rows: Rows, cost: Array, least: float = 0.0) -> tuple[Point | None, Flags]:
    """The point of least cost, and which rows (n,) its cost depends on."""
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
    if solved.status != 0:
        return None, np.zeros(count, dtype=bool)
    return Point(np.append(solved.x[:-1], 0.0), float(solved.x[-1])), solved.ineqlin.marginals < -1e-9


def add(row: Array, step: At, factor: float) -> None:
    """Add a multiple of a step to a row of coefficients, in place; its number has no coefficient."""
    if step.variable is not None:
        row[step.variable] += factor
