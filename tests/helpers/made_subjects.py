"""Subjects whose least robustness is known: their signals stay where they start, so a formula is one of the start."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from helpers.pair_task import pair
from stlbench.contract import Array
from stlbench.search.actor import Actor
from stlbench.simulation.referee import Episodes

WELL = "G[0,8] norm(a + 0.7, b - 0.3) >= 0.05"
"""Violated in a disc that is 0.8 % of the box a in [-1, 0], b in [0, 1]; least robustness -0.05, at its centre."""


def still(formula: str = WELL, **changes: Any) -> Actor:
    """On the task of two robots; every trace has its start at all of its samples."""
    task = pair(formula=formula, **changes)

    def record(starts: Array) -> Episodes:
        traces = np.repeat(starts[:, None], task.file.steps + 1, axis=1)
        return Episodes(traces, np.full(len(starts), task.file.steps))

    return Actor("still", ("still",), task, record)


def ending(actor: Actor, last: int, beyond: float = -np.inf, stays: bool = False) -> Actor:
    """The actor, whose episodes end early, at step `last`, where they start at an a above `beyond`.

    NaN follows, or the last sample stays.
    """

    def record(starts: Array) -> Episodes:
        traces, lasted = actor.record(starts)
        ends = starts[:, 0] > beyond
        traces[ends, last + 1 :] = traces[ends, last : last + 1] if stays else np.nan
        return Episodes(traces, np.where(ends, last, lasted))

    return replace(actor, record=record)


def watched(actor: Actor) -> tuple[Actor, list[Array]]:
    """The same actor, and the batches of starts that it is asked to play."""
    met = list[Array]()

    def record(starts: Array) -> Episodes:
        met.append(starts)
        return actor.record(starts)

    return replace(actor, record=record), met
