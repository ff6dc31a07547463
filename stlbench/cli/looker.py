"""What goes on in a folder of results, looked at from outside."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from stlbench.cli.live import MOST, begun_of, line_of, remaining
from stlbench.errors import UsageError
from stlbench.result import CellId, Result
from stlbench.study import lock, stored
from stlbench.study.ledger import FILE
from stlbench.study.outlook import Took
from stlbench.study.running import Running, running

__all__ = ["Looker", "View"]


_STRETCH = 4.0
"""Times of cells are stretched so much at most."""
_BEFORE = 120.0
"""Seconds that a run may need from its beginning until it holds the lock."""


class View(NamedTuple):
    """What there was at one time."""

    now: float
    """Seconds since 1970."""
    writer: str | None
    """Who writes in the folder; None where nobody does."""
    since: float | None
    """When that began, in seconds since 1970, as far as it is known."""
    running: Sequence[Running]
    results: Sequence[Result]
    """Those that were there at the first look by name, then as they came."""
    missing: Sequence[CellId]

    @property
    def total(self) -> int:
        """Cells, those without a result among them."""
        return len(self.results) + len(self.missing)

    @property
    def left(self) -> str:
        """How long the rest may take; empty where nobody writes, or nobody knows."""
        if not self.writer:
            return ""
        begun = begun_of(self.running, self.now)
        waiting = [cell for cell in self.missing if all(cell != one.cell for one in begun)]
        took = [Took(each.id, each.measurement.wall_seconds) for each in self.results if each.measurement]
        jobs, busy = self._busy()
        passed = 0.0 if self.since is None else (self.now - self.since) * jobs
        scale = min(max(1.0, passed / busy), _STRETCH) if busy else 1.0
        return remaining(waiting, begun, took, jobs, scale)

    def _busy(self) -> tuple[int, float]:
        """Cells at a time, and the seconds that cells of this run took so far, of those that ended here at least one.

        Cells do not count what it takes to start them, nor the time until another one begins: so their times are
        stretched to fill the time that has passed, as `Progress` does it.
        """
        here = [each for each in self.results if each.measurement and self._of_this_run(each)]
        ended = sum(each.measurement.wall_seconds for each in here if each.measurement)
        said = [int(text) for each in here if (text := each.provenance.get("jobs", "")).isdecimal()]
        jobs = max([1, len(self.running), *said])
        return jobs, ended + sum(max(0.0, self.now - one.began) for one in self.running) if here else 0.0

    def _of_this_run(self, result: Result) -> bool:
        """By the time when its run began, which is some seconds before that run holds the lock."""
        if self.since is None:
            return False
        try:
            began = datetime.fromisoformat(result.provenance.get("time", "")).timestamp()
        except ValueError:
            return False
        return began > self.since - _BEFORE

    @property
    def counts(self) -> str:
        """ "2 of 3 cells, 1 done, 1 raised, 1 running, about 12 s left"."""
        statuses = Counter[str](result.status for result in self.results)
        said = [f"{len(self.results)} of {self.total} cells"]
        said += [f"{count} {status}" for status, count in statuses.items()]
        said += [f"{len(self.running)} running"] if self.writer else ["nobody writes here"]
        return ", ".join([*said, *([self.left] if self.left else [])])

    def lines(self, *, drawn: bool) -> list[str]:
        """For a terminal, with curves where they are `drawn`."""
        more = [f"  and {len(self.running) - MOST} more"] if len(self.running) > MOST else []
        cells = [f"  {line_of(one, self.now, drawn=drawn)}" for one in self.running[:MOST]]
        return [self.counts, *cells, *more]


class Looker:
    """Reads a folder; its ledger only when that has changed. Raises `UsageError` where there is none."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / FILE
        if not self.path.is_file():
            raise UsageError(f"there is no ledger in {folder}/; name a folder that `stlbench run` writes")
        self.stamp: tuple[float, ...] = ()
        self.results: list[Result] = []
        self.missing: list[CellId] = []

    def look(self) -> View:
        """What there is now."""
        writer = lock.writer(self.folder)
        self._read()
        cells = running(self.folder) if writer else []
        return View(time.time(), writer, _since(writer), cells, self.results, self.missing)

    def _read(self) -> None:
        stamp = tuple(path.stat().st_mtime for path in self.folder.glob(f"{self.path.name}*"))
        if stamp != self.stamp:
            found = {result.id: result for result in stored.read(self.folder)}
            known = [found.pop(before.id) for before in self.results if before.id in found]
            self.results, self.missing = [*known, *found.values()], stored.missing(self.folder)
            self.stamp = stamp


def _since(writer: str | None) -> float | None:
    """Of "process 12 on host, since 2026-11-22T19:00:00+00:00"."""
    try:
        return datetime.fromisoformat((writer or "").rpartition("since ")[2].strip()).timestamp()
    except ValueError:
        return None
