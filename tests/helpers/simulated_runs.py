"""A study that runs on paper: cells of known lengths, so many at a time, looked at when a part of it is over."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import NamedTuple

from stlbench.records.identity import CellId
from stlbench.study.outlook import Begun, Took


class Seen(NamedTuple):
    """What can be known at one moment."""

    now: float
    """Seconds since the beginning of the run."""
    waiting: list[CellId]
    begun: list[Begun]
    took: list[Took]
    left: float
    """Seconds that the run still takes in truth."""
    recorded: list[float]
    """When those that ended were recorded."""


class Idle(NamedTuple):
    """Seconds of a run that no cell counts, and what checkpoints do not tell."""

    before: float = 0.0
    """Until the first cell begins."""
    between: float = 0.0
    """From the end of a cell until the next one in its place begins."""
    scored: float = 0.0
    """The share of a cell's time that comes after its last checkpoint."""


def simulate(
    cells: Sequence[tuple[CellId, float]], jobs: int, share: float, checkpoints: int = 10, idle: Idle | None = None
) -> Seen:
    """Cells in their order with their seconds; seen when so much of the time of the whole run has passed."""
    idle = idle or Idle()
    spans = _spans(cells, jobs, idle)
    end = max(ends for _, _, ends in spans) + idle.between
    now = share * end
    begun = list[Begun]()
    for cell, begins, ends in spans:
        if begins <= now < ends:
            trains = (1 - idle.scored) * (ends - begins)
            done = min(int(checkpoints * (now - begins) / trains), checkpoints) / checkpoints
            begun.append(Begun(cell, now - begins, done, done * trains))
    waiting = [cell for cell, begins, _ in spans if begins > now]
    over = [(Took(cell, ends - begins), ends) for cell, begins, ends in spans if ends <= now]
    return Seen(now, waiting, begun, [took for took, _ in over], end - now, [ends for _, ends in over])


def _spans(cells: Sequence[tuple[CellId, float]], jobs: int, idle: Idle) -> list[tuple[CellId, float, float]]:
    """Each cell with its begin and its end."""
    free = [idle.before] * jobs
    spans = list[tuple[CellId, float, float]]()
    for cell, seconds in cells:
        begins = heapq.heappop(free)
        spans.append((cell, begins, begins + seconds))
        heapq.heappush(free, begins + seconds + idle.between)
    return spans
