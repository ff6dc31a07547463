"""How long the rest of a run takes: one answer, for the run itself and for whoever watches it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from functools import lru_cache
from itertools import accumulate
from statistics import fmean
from typing import NamedTuple

from stlbench.records.identity import CellId, Setting
from stlbench.records.result import Result
from stlbench.registry.choices import Choice
from stlbench.study.live_cells import Running, duration
from stlbench.study.outlook import Begun, Took, time_left

LATEST = 2_000
"""Cells that ended, of which so many tell enough: more would make large studies slow."""

_SOON = 0.5
"""Seconds. Less is rounded to 0, which a cell that runs longer than all before it would say until it ends."""

_UNFIT = ("intractable", "unsuitable")
"""Found out at once and for every seed, so that such cells take no time."""


class Ended(NamedTuple):
    """A cell that ended in this run, and was measured."""

    cell: CellId
    seconds: float
    """That it took, by its own clock."""
    at: float
    """When it was recorded, in seconds since 1970."""


class Pace(NamedTuple):
    """A run at one moment, as far as it tells how long the rest takes.

    The time before the first cell begins does not count: agents are compiled in it, for example.
    """

    now: float
    """Seconds since 1970."""
    missing: Collection[CellId]
    """Cells that have no result, those that run among them, in the order in which they begin."""
    running: Sequence[Running]
    ended: Collection[Ended]
    """The latest are enough: `LATEST`."""
    allowed: int = 0
    """Cells that may run at a time; 0 where nobody knows."""
    earlier: Sequence[Took] = ()
    """Cells of runs before this one."""

    @property
    def words(self) -> str:
        """ "about 3 min 5 s left"; empty where nothing is left or known, as of a cell slower than all before."""
        seconds = self.seconds
        return f"about {duration(seconds)} left" if seconds and seconds >= _SOON else ""

    @property
    def seconds(self) -> float | None:
        """Until the last cell ends; None where nothing is left, or nothing is known."""
        begun = [one for one in _begun(self.running, self.now) if one.cell in self.missing]
        at_work = {one.cell for one in begun}
        waiting = [cell for cell in self.missing if cell not in at_work]
        if not waiting and not begun:
            return None
        took = [Took(each.cell, each.seconds) for each in self.ended]
        known = [*took, *_as_now(self.earlier, took, begun)]
        return time_left(waiting, begun, known, self.jobs, _size, self.between)

    @property
    def jobs(self) -> int:
        """Cells at a time: the most that overlapped so far, as long as so many are allowed."""
        spans = self._spans()
        changes = sorted([*((begin, 1) for begin, _ in spans), *((end, -1) for _, end in spans)])
        most = max(accumulate(change for _, change in changes), default=1)
        return max(1, len(self.running), min(most, self.allowed or most))

    @property
    def between(self) -> float:
        """Seconds from the end of a cell until the next one in its place has begun, on average."""
        spans = self._spans()
        begins, ends = sorted(begin for begin, _ in spans), sorted(end for _, end in spans)
        gaps = [begin - end for begin, end in zip(begins[self.jobs :], ends, strict=False)]
        return max(0.0, fmean(gaps)) if gaps else 0.0

    def _spans(self) -> list[tuple[float, float]]:
        """When cells began and ended; those that run end now."""
        ended = [(each.at - each.seconds, each.at) for each in self.ended]
        return [*ended, *((one.began, max(self.now, one.began)) for one in self.running)]


def reward_of(cell: CellId) -> tuple[Choice, Choice]:
    """What decides whether a method fits: its task, and the method."""
    return cell.task, cell.method


def unfit(results: Iterable[Result]) -> set[tuple[Choice, Choice]]:
    """The methods that do not fit their task, as `reward_of` has them: their cells are over as they begin."""
    return {reward_of(each.id) for each in results if each.status in _UNFIT}


def _begun(cells: Iterable[Running], now: float) -> list[Begun]:
    return [Begun(one.id, max(0.0, now - one.began), one.share, max(0.0, one.told - one.began)) for one in cells]


def _as_now(earlier: Sequence[Took], took: Sequence[Took], begun: Sequence[Begun]) -> list[Took]:
    """What cells of other settings took earlier, as they would take now: a machine is busier at some times."""
    ended = {cell.setting for cell, _ in took}
    told = [Took(one.cell, one.at / one.share) for one in begun if one.share > 0 and one.cell.setting not in ended]
    before, today = _means(earlier), _means([*took, *told])
    both = before.keys() & today.keys()
    scale = sum(today[each] for each in both) / sum(before[each] for each in both) if both else 1.0
    return [Took(cell, scale * seconds) for cell, seconds in earlier if cell.setting not in ended]


def _means(took: Sequence[Took]) -> dict[Setting, float]:
    found = dict[Setting, list[float]]()
    for cell, seconds in took:
        found.setdefault(cell.setting, []).append(seconds)
    return {setting: fmean(values) for setting, values in found.items()}


def _size(cell: CellId) -> int | None:
    """Environment steps of a cell's training; None where its task is not installed here."""
    return _steps(cell.task, cell.budget)


@lru_cache(maxsize=1024)
def _steps(task: Choice, budget: str) -> int | None:
    from stlbench.errors import UsageError
    from stlbench.task import load_task

    try:
        return load_task(task).budget(budget).steps
    except UsageError:
        return None
