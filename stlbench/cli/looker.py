"""What goes on in a folder of results, looked at from outside."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from heapq import nlargest
from pathlib import Path
from typing import NamedTuple

from stlbench.errors import UsageError
from stlbench.records import lock, stored
from stlbench.records.identity import CellId
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.result import Result
from stlbench.study.live_cells import MOST, Running, line_of, running
from stlbench.study.outlook import Took
from stlbench.study.pace import LATEST, Ended, Pace, reward_of, unfit


class View(NamedTuple):
    """What there was at one time."""

    now: float
    """Seconds since 1970."""
    writer: str | None
    """Who writes in the folder; None where nobody does."""
    running: Sequence[Running]
    results: Sequence[Result]
    """Those that were there at the first look by name, then as they came."""
    missing: Sequence[CellId]
    recorded: Mapping[str, float]
    """Of each result that this writer recorded, by its key, when: in seconds since 1970."""

    @property
    def total(self) -> int:
        """Cells, those without a result among them."""
        return len(self.results) + len(self.missing)

    @property
    def left(self) -> str:
        """How long the rest may take; empty where nobody writes, or nobody knows."""
        return self._pace().words if self.writer else ""

    def _pace(self) -> Pace:
        measured = [(each, each.measurement) for each in self.results if each.measurement]
        ended = [
            Ended(each.id, found.wall_seconds, self.recorded[each.key])
            for each, found in measured
            if each.key in self.recorded
        ]
        earlier = [Took(each.id, found.wall_seconds) for each, found in measured if each.key not in self.recorded]
        said = {each.provenance.get("jobs", "") for each, _ in measured if each.key in self.recorded}
        never = unfit(self.results)
        missing = [cell for cell in self.missing if reward_of(cell) not in never]
        latest = nlargest(LATEST, ended, key=lambda each: each.at)
        return Pace(self.now, missing, self.running, latest, _greatest(said), earlier[-LATEST:])

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
        self.stamp: tuple[object, ...] = ()
        self.results: list[Result] = []
        self.missing: list[CellId] = []
        self.recorded: Mapping[str, float] = {}

    def look(self) -> View:
        """What there is now."""
        writer = lock.writer(self.folder)
        self._read(writer)
        cells = running(self.folder) if writer else []
        return View(time.time(), writer, cells, self.results, self.missing, self.recorded)

    def _read(self, writer: str | None) -> None:
        stamp = (writer, *(path.stat().st_mtime for path in self.folder.glob(f"{self.path.name}*")))
        if stamp != self.stamp:
            found = {result.id: result for result in stored.read(self.folder)}
            known = [found.pop(before.id) for before in self.results if before.id in found]
            self.results, self.stamp = [*known, *found.values()], stamp
            with Ledger(self.path, create=False) as ledger:
                self._read_ledger(ledger, _since(writer))

    def _read_ledger(self, ledger: Ledger, since: datetime | None) -> None:
        missing = set(ledger.missing())
        self.missing = [cell for cell in ledger.planned().values() if cell in missing]
        self.recorded = {} if since is None else ledger.recorded_since(since)


def _greatest(texts: Iterable[str]) -> int:
    """Of the numbers among these; 0 where there is none."""
    return max((int(text) for text in texts if text.isdecimal()), default=0)


def _since(writer: str | None) -> datetime | None:
    """Of "process 12 on host, since 2026-11-22T19:00:00+00:00"."""
    try:
        return datetime.fromisoformat((writer or "").rpartition("since ")[2].strip())
    except ValueError:
        return None
