"""Before anything is called slower, it is measured again: load that comes and goes passes, a slower program stays."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

from stlbench.gate.judge import judge
from stlbench.gate.metrics import METRICS
from stlbench.gate.snapshot import Sample, Snapshot, pair
from stlbench.identity import CellId

__all__ = ["RETAKES", "middle", "settle"]

RETAKES = (2, 3)
"""Numbers of the takes after the first. With three there is one in the middle."""


def settle(base: Snapshot, new: Snapshot, again: Callable[[Collection[CellId], int], Snapshot]) -> Snapshot:
    """The new snapshot, in which each suspicious cell has its middle times of three takes.

    Suspicious are all cells of a setting of which a time is worse or cannot be told. A take measures them all, one
    after the other, before the next begins. What robustness and satisfaction say is not measured again: on one machine
    a cell's are the same to the last bit.

    Args:
        base: what is compared with.
        new: the first take, of all cells.
        again: measures these cells once more, given the number of the take.
    """
    times = [comparison for comparison in judge(pair(base, new)).comparisons if comparison.metric.timing]
    settings = {comparison.setting for comparison in times if comparison.verdict != "no worse"}
    suspicious = [cell for cell in new.samples if cell.setting in settings]
    if not suspicious:
        return new
    takes = [again(suspicious, number).samples for number in RETAKES]
    settled = {
        cell: middle([new.samples[cell], *(take[cell] for take in takes if cell in take)]) for cell in suspicious
    }
    return replace(new, samples={**new.samples, **settled})


def middle(takes: Sequence[Sample]) -> Sample:
    """The first take, with each time from the take in the middle, the lower one of two; of those that have it."""
    settled = takes[0]
    for metric in METRICS:
        values = {value: take for take in takes if metric.timing and (value := metric.value(take)) is not None}
        if values:
            chosen = values[sorted(values)[(len(values) - 1) // 2]]
            settled = replace(settled, **{column: getattr(chosen, column) for column in metric.columns})
    return settled
