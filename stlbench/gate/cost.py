"""Does the change cost more than its base? Both train the same cell by turns, one right after the other.

Each turn gives one ratio. The median ratio of a setting is compared with the tolerated one by its exact 95 % interval,
which assumes no distribution (the interval of the sign test: Conover 1999, Practical Nonparametric Statistics, 3.2).
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from stlbench.gate.judge import COSTS, QUALITIES, Comparison, Judgement, Metric, Verdict, judge
from stlbench.gate.snapshot import Sample, Snapshot
from stlbench.records.identity import CellId, Setting
from stlbench.report.statistics.intervals import median_interval

MOST = 50  # turns of a setting after which its verdict stays open
ROUNDS = 2  # the fewest rounds after which anything is worse: slower code stays slow, and disturbances go
FEWEST = 6  # turns from which on the median has an interval of 95 %


class Turn(NamedTuple):
    """One cell, trained by both sides; None if a revision does not know the cell."""

    cell: CellId
    round: int
    """From 1. Each round has each cell of a setting once."""
    base: Sample | None
    new: Sample | None


def judge_turns(reference: Snapshot, turns: Sequence[Turn]) -> tuple[Judgement, Snapshot]:
    """The verdict on a change, and the snapshot of its cells.

    Costs are compared turn by turn. Robustness and satisfaction are compared with the reference if the two are equal,
    else with the base's values on this machine: the reference's machine may round differently.
    """
    first = [turn for turn in turns if turn.round == 1]
    new = Snapshot({turn.cell: turn.new for turn in first if turn.new is not None})
    given = {turn.cell: turn.base for turn in first if turn.base is not None}
    expected = {
        cell: sample if _same(sample, new.samples.get(cell)) else given.get(cell, sample)
        for cell, sample in reference.samples.items()
    }
    judgement = judge(Snapshot(expected), new)
    qualities = tuple(comparison for comparison in judgement.comparisons if not comparison.metric.is_cost)
    return Judgement((*qualities, *judge_costs(turns)), judgement.findings), new


def _same(one: Sample, two: Sample | None) -> bool:
    return two is not None and all(metric.value(one) == metric.value(two) for metric in QUALITIES)


def judge_costs(turns: Iterable[Turn]) -> tuple[Comparison, ...]:
    """Both costs of each setting of which both sides finished a cell.

    A setting is *worse* if its whole interval is above the tolerated ratio after two rounds or more, and *no worse* if
    its whole interval is at most that ratio; otherwise the turns *cannot tell*.
    """
    settings: dict[Setting, list[Turn]] = {}
    for turn in turns:
        settings.setdefault(turn.cell.setting, []).append(turn)
    compared = (_compare(setting, metric, own) for metric in COSTS for setting, own in sorted(settings.items()))
    return tuple(comparison for comparison in compared if comparison is not None)


def unclear(turns: Sequence[Turn]) -> set[Setting]:
    """The settings that need more turns: the verdict on one of their costs is still open."""
    taken = Counter(turn.cell.setting for turn in turns)
    open_ones = {each.setting for each in judge_costs(turns) if each.verdict == "cannot tell"}
    return {setting for setting in open_ones if taken[setting] < MOST}


def _compare(setting: Setting, metric: Metric, turns: Sequence[Turn]) -> Comparison | None:
    values = [
        (base, new)
        for turn in turns
        if turn.base is not None and turn.new is not None
        if (base := metric.value(turn.base)) and (new := metric.value(turn.new))
    ]
    if not values:
        return None
    base, new = np.array(values).T
    gains = metric.gain(base, new)
    low, high = (len(gains) >= FEWEST and median_interval(gains.tolist())) or (-math.inf, math.inf)
    verdict: Verdict = "cannot tell"
    if low >= -metric.tolerated:
        verdict = "no worse"
    elif high < -metric.tolerated and max(turn.round for turn in turns) >= ROUNDS:
        verdict = "worse"
    chance = float(special.bdtr(int(np.sum(gains >= -metric.tolerated)), len(gains), 0.5))
    middle = float(np.median(base)), float(np.median(new))
    gain, turned = float(np.median(gains)), tuple(gains.tolist())
    return Comparison(setting, metric, *middle, len(turned), gain, low, high, chance, verdict, turned)
