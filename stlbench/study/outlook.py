"""How long a study still takes, from the cells that ended and from those that run."""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Sequence
from statistics import fmean
from typing import NamedTuple

from stlbench.records.identity import CellId, Setting


class Took(NamedTuple):
    """A cell that ended, and how many seconds it took."""

    cell: CellId
    seconds: float


class Begun(NamedTuple):
    """A cell that runs."""

    cell: CellId
    seconds: float
    """Since it began."""
    share: float
    """Of its training, done at its last checkpoint."""
    at: float
    """Seconds from its beginning to that checkpoint."""


Size = Callable[[CellId], int | None]
"""Environment steps of a cell's training; None where nobody knows."""

_ROUNDS = 5
"""In which the factors of tasks and of methods are found."""


def time_left(
    waiting: Sequence[CellId],
    begun: Sequence[Begun],
    took: Sequence[Took],
    jobs: int,
    size: Size = lambda cell: None,
    between: float = 0.0,
) -> float | None:
    """Seconds until the last cell ends, as far as one can know; None while nothing is known.

    A cell is expected to take as long as those did that differ in the seed alone. Where there are none, its
    environment steps count, with a factor of its task and one of its method, as far as either is known. One that runs
    also tells by its checkpoints. Cells begin in their order, each when one before it has ended.

    Args:
        waiting: cells that have not begun, in the order in which they will.
        begun: cells that run.
        took: cells that ended.
        jobs: how many run at a time.
        size: of a cell, to compare tasks by.
        between: seconds from the end of a cell until the next one in its place has begun.
    """
    ended = {each.cell.setting for each in took}
    told = [one for one in begun if one.share > 0 and one.cell.setting not in ended]
    known = [*took, *(Took(one.cell, one.at / one.share) for one in told)]
    if not known:
        return None
    guess = _Guess(known, size)
    free = [_rest(one, took, guess) for one in begun]
    free += [0.0] * (jobs - len(free))
    heapq.heapify(free)
    for cell in waiting:
        heapq.heappush(free, heapq.heappop(free) + between + guess.of(cell))
    return max(free, default=0.0)


def _rest(one: Begun, took: Sequence[Took], guess: _Guess) -> float:
    """What is left of a cell that runs: by cells of its setting that ended, else by its own checkpoints."""
    alike = [other.seconds for other in took if other.cell.setting == one.cell.setting]
    if alike and fmean(alike) > one.seconds:
        return fmean(alike) - one.seconds
    own = one.at / one.share if one.share > 0 else guess.of(one.cell)
    return max(own - one.seconds, 0.0)


class _Guess:
    """How long cells take: seconds per environment step, times a factor of the task, times one of the method."""

    def __init__(self, known: Sequence[Took], size: Size) -> None:
        self._size, self._settings = size, dict[Setting, list[float]]()
        logs = list[tuple[CellId, float]]()
        for cell, seconds in known:
            self._settings.setdefault(cell.setting, []).append(seconds)
            if steps := size(cell):
                logs.append((cell, math.log(max(seconds, 1e-3) / steps)))
        self._all = fmean(each.seconds for each in known)
        mean = fmean(value for _, value in logs) if logs else 0.0
        self._mean = mean if logs else None
        self._tasks, self._methods = dict[object, float](), dict[object, float]()
        for _ in range(_ROUNDS):
            self._tasks = _factors(logs, _task, lambda cell: mean + self._methods.get(_method(cell), 0.0))
            self._methods = _factors(logs, _method, lambda cell: mean + self._tasks.get(_task(cell), 0.0))

    def of(self, cell: CellId) -> float:
        """Seconds; the mean of all where nothing better is known."""
        if cell.setting in self._settings:
            return fmean(self._settings[cell.setting])
        steps = self._size(cell)
        if not steps or self._mean is None:
            return self._all
        return steps * math.exp(self._mean + self._tasks.get(_task(cell), 0.0) + self._methods.get(_method(cell), 0.0))


def _task(cell: CellId) -> object:
    return cell.task, cell.agent


def _method(cell: CellId) -> object:
    return cell.method


def _factors(
    logs: Sequence[tuple[CellId, float]], key: Callable[[CellId], object], rest: Callable[[CellId], float]
) -> dict[object, float]:
    """Of each key the mean of what the rest leaves of the logarithms."""
    found = dict[object, list[float]]()
    for cell, value in logs:
        found.setdefault(key(cell), []).append(value - rest(cell))
    return {which: fmean(values) for which, values in found.items()}
