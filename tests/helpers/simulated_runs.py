"""A study that runs on paper: cells of known lengths, so many at a time, looked at when a part of it is over."""

from __future__ import annotations

import heapq
from collections.abc import Sequence
from typing import NamedTuple

from stlbench.result import CellId
from stlbench.study.outlook import Begun, Took


class Seen(NamedTuple):
    """What can be known at one moment."""

    waiting: list[CellId]
    begun: list[Begun]
    took: list[Took]
    left: float
    """Seconds that the run still takes in truth."""


def simulate(cells: Sequence[tuple[CellId, float]], jobs: int, share: float, checkpoints: int = 10) -> Seen:
    """Cells in their order with their seconds; seen when so much of the time of the whole run has passed."""
    free = [0.0] * jobs
    spans = list[tuple[CellId, float, float]]()
    for cell, seconds in cells:
        begins = heapq.heappop(free)
        spans.append((cell, begins, begins + seconds))
        heapq.heappush(free, begins + seconds)
    end = max(free)
    now = share * end
    begun = list[Begun]()
    for cell, begins, ends in spans:
        if begins <= now < ends:
            done = int(checkpoints * (now - begins) / (ends - begins)) / checkpoints
            begun.append(Begun(cell, now - begins, done, done * (ends - begins)))
    waiting = [cell for cell, begins, _ in spans if begins > now]
    took = [Took(cell, ends - begins) for cell, begins, ends in spans if ends <= now]
    return Seen(waiting, begun, took, end - now)
