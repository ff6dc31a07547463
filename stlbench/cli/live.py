"""What runs just now, and how long the rest takes, in words."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from functools import lru_cache
from pathlib import Path

from stlbench.registry.choices import Choice
from stlbench.result import CellId
from stlbench.study import running
from stlbench.study.outlook import Begun, Took, time_left
from stlbench.study.running import Running

__all__ = ["MOST", "Sight", "begun_of", "duration", "line_of", "remaining", "size_of"]

MOST = 8
"""Cells that are listed; the others are counted."""


class Sight:
    """Looks at most once a second at which cells run."""

    def __init__(self, folder: Path | None) -> None:
        self._folder, self._seen, self._at = folder, list[Running](), -1.0
        self.jobs = 1
        """The most that ran at a time."""

    def look(self) -> list[Running]:
        """The cells that run; none where there is no folder."""
        now = time.time()
        if self._folder is not None and now - self._at >= 1:
            self._seen, self._at = running.running(self._folder), now
            self.jobs = max(self.jobs, len(self._seen))
        return self._seen


def line_of(one: Running, now: float) -> str:
    """hold-disc/funnel/dqn/3: 42 %, 16,800 of 40,000 steps, 12 s; satisfied 88 %, robustness 0.310."""
    score = "" if one.satisfaction is None or one.robustness is None else _score(one.satisfaction, one.robustness)
    done = f"{100 * one.share:.0f} %, {one.steps:,} of {one.of:,} steps" if one.share < 1 else "trained, is scored"
    return f"{one.name}: {done}, {duration(max(0.0, now - one.began))}{score}"


def _score(satisfaction: float, robustness: float) -> str:
    return f"; satisfied {100 * satisfaction:.0f} %, robustness {robustness:.3f}"


def begun_of(cells: Iterable[Running], now: float) -> list[Begun]:
    """The same, for an outlook."""
    return [Begun(one.id, max(0.0, now - one.began), one.share, max(0.0, one.told - one.began)) for one in cells]


def size_of(cell: CellId) -> int | None:
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


def remaining(
    waiting: Sequence[CellId], begun: Sequence[Begun], took: Sequence[Took], jobs: int, scale: float = 1.0
) -> str:
    """How long the rest may take: "about 3 min 5 s left"; empty where nothing is left, or nothing is known."""
    seconds = time_left(waiting, begun, took, jobs, size_of) if waiting or begun else None
    return "" if seconds is None else f"about {duration(scale * seconds)} left"


def duration(seconds: float) -> str:
    """ "12 s", "3 min 5 s", "2 h 10 min"."""
    minutes, rest = divmod(round(seconds), 60)
    return (
        f"{minutes // 60} h {minutes % 60} min"
        if minutes >= 60
        else f"{minutes} min {rest} s"
        if minutes
        else f"{rest} s"
    )
