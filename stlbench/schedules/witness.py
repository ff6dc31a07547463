"""The times of a plan around witnesses: episodes that satisfy a formula, and so show how fast a robot is.

A mixed-integer programme chooses where each witness meets each event, and the windows around these steps.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Truth
from stlbench.schedules.plan import At, Event, Held
from stlbench.schedules.times import Programme, Times

_SECONDS = 2.0
"""Seconds for one programme, at most. It takes milliseconds, unless witnesses meet a region many times. One that is
stopped may have other windows on another machine."""


def times_around(programme: Programme, traces: Array, names: Sequence[str]) -> tuple[int, Times] | None:
    """The steps that each window leaves at least after a witness has met it, and times with the widest such windows.

    Args:
        programme: of a plan.
        traces: samples (n, T + 1, k) that satisfy the formula.
        names: of the k signals.

    Returns:
        None where the traces are not all of this plan, or where it asks for nothing.
    """
    if not programme.items:
        return None
    model = _Model(programme, traces.shape[1])
    for trace in traces:
        met = dict[int, At]()
        for place, item in enumerate(programme.items):
            runs = _runs(stl.holds(item.psi, tuple(names))(trace))
            if isinstance(item, Event):
                met[place] = model.meet(item, runs)
            else:
                model.keep(item, runs)
        model.leave_time(met)
    margin = np.zeros(model.margin + 1)
    margin[model.margin] = -1.0
    found = model.solved(margin, 0)
    if found is None:
        return None
    least = int(found[model.margin] + 1e-6)  # whole but for the solver's tolerance
    widest = model.solved(programme.narrow, least)
    values = np.round(found if widest is None else widest)
    return least, Times(0.0, tuple(values[: programme.plan.variables].astype(int).tolist()))


def _runs(true: Truth) -> list[tuple[int, int]]:
    """The first and last step of each stretch in which something is true (T + 1,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], true, [False]]).astype(np.int8)))
    return [(int(begin), int(end) - 1) for begin, end in edges.reshape(-1, 2)]


class _Model:
    """Variables: those of the plan; the margin; then steps at which events are met, and choices, which are 0 or 1."""

    def __init__(self, programme: Programme, samples: int) -> None:
        self._items, self._big = programme.items, 4.0 * samples  # no row of four steps and a gap is broken by more
        self.margin = programme.plan.variables
        self._choice = [False] * (self.margin + 1)
        self._rows, self._most = list[dict[int, float]](), list[float]()
        for earlier, later, gap in programme.rows.between():
            self._order(earlier, later, gap)
        self._turns = dict[tuple[int, int], int]()
        for (i, j), *both in zip(programme.pairs, programme.ways[::2], programme.ways[1::2], strict=True):
            for turn, choice, way in zip([(i, j), (j, i)], self._choices(2), both, strict=True):
                self._turns[turn] = choice
                for earlier, later, gap in way.between():
                    self._order(earlier, later, gap, choice)

    def meet(self, event: Event, runs: Sequence[tuple[int, int]]) -> At:
        """Let a witness that is in a region in these runs meet the event; the step."""
        step = At(0, self._variable())
        self._order(event.begin, step)
        self._order(step, event.end, margin=1.0)
        for choice, (begin, end) in zip(self._choices(len(runs)), runs, strict=True):
            self._order(At(begin), step, choice=choice)
            self._order(step, At(end - event.stay), choice=choice)
        return step

    def leave_time(self, met: Mapping[int, At]) -> None:
        """A robot that meets an event at the end of its window has the time of a witness for the way to the next."""
        for (first, second), choice in self._turns.items():
            if first in met and second in met:
                self._row([self._items[first].end, met[second]], [self._items[second].end, met[first]], choice=choice)

    def keep(self, held: Held, runs: Sequence[tuple[int, int]]) -> None:
        """Let a witness for which a condition holds in these runs keep it, or let it be held at no step."""
        never, *choices = self._choices(len(runs) + 1)
        self._order(held.end, held.begin, 1, never)
        for choice, (begin, end) in zip(choices, runs, strict=True):
            self._order(At(begin), held.begin, choice=choice)
            self._order(held.end, At(end), choice=choice)

    def solved(self, cost: Array, least: int) -> Array | None:
        """The values of all variables of least cost, with at least this margin.

        `cost` is of the plan's variables, then of the margin; the others cost nothing.
        """
        from scipy.optimize import Bounds, LinearConstraint, milp  # which most commands do without
        from scipy.sparse import coo_array

        count = len(self._choice)
        entries = [(value, row, column) for row, found in enumerate(self._rows) for column, value in found.items()]
        data, row, column = (np.array(each) for each in zip(*entries, strict=True))
        rows = coo_array((data, (row, column)), shape=(len(self._rows), count)).tocsr()
        low, high = np.zeros(count), np.where(self._choice, 1.0, self._big)
        low[self.margin] = least
        found = milp(
            np.append(cost, np.zeros(count - len(cost))),
            constraints=LinearConstraint(rows, ub=np.array(self._most)),
            integrality=np.ones(count, dtype=np.int64),
            bounds=Bounds(low, high),
            options={"time_limit": _SECONDS},
        )
        values: Array | None = found.x
        return values

    def _variable(self, choice: bool = False) -> int:
        self._choice.append(choice)
        return len(self._choice) - 1

    def _choices(self, count: int) -> list[int]:
        """Variables of which exactly one is 1; where there are none, nothing is possible."""
        made = [self._variable(choice=True) for _ in range(count)]
        for sign in (1.0, -1.0):
            self._rows.append(dict.fromkeys(made, sign))
            self._most.append(sign)
        return made

    def _order(self, earlier: At, later: At, gap: int = 0, choice: int | None = None, margin: float = 0.0) -> None:
        """earlier + gap + margin <= later, if a choice is made."""
        self._row([earlier + gap], [later], choice, margin)

    def _row(self, less: Sequence[At], more: Sequence[At], choice: int | None = None, margin: float = 0.0) -> None:
        """The sum of some steps, and the margin, is at most that of others, if a choice is made."""
        row, most = dict[int, float](), 0.0
        for steps, sign in ((less, 1.0), (more, -1.0)):
            for at in steps:
                most -= sign * at.offset
                if at.variable is not None:
                    row[at.variable] = row.get(at.variable, 0.0) + sign
        if margin:
            row[self.margin] = margin
        if choice is not None:
            row[choice] = self._big
            most += self._big
        self._rows.append(row)
        self._most.append(most)
