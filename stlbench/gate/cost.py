"""Does the change cost more than its base? Only turns can tell: both train the same cell, one right after the other.

Each turn gives one ratio. The median of a setting's ratios is compared with the tolerated one, by its exact 95 %
interval, which supposes nothing of how the ratios are distributed (the interval of the sign test: Conover 1999,
Practical Nonparametric Statistics, section 3.2).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from stlbench.gate.judge import Comparison, Judgement, Verdict, judge
from stlbench.gate.metrics import COSTS, QUALITIES, Metric
from stlbench.gate.snapshot import Sample, Snapshot, pair
from stlbench.records.identity import CellId, Setting

MOST = 50
"""Turns of a setting after which it is left open."""
ROUNDS = 2
"""The fewest rounds after which anything is worse: what is slower stays so, and what disturbs comes and goes."""
TAIL = 0.025
"""Probability that the median is beyond one end of its interval, at most."""


class Turn(NamedTuple):
    """One cell, trained by both sides; None where a revision does not know the cell."""

    cell: CellId
    round: int
    """From 1. Each round has each cell of a setting once."""
    base: Sample | None
    new: Sample | None


def judge_turns(reference: Snapshot, turns: Sequence[Turn]) -> tuple[Judgement, Snapshot]:
    """The verdict on a change, and what its code gave.

    Costs are compared turn by turn. Robustness and satisfaction are compared with the reference where the two agree to
    the last bit, and else with what the base gave here: another machine may round otherwise than that of the reference.
    """
    first = [turn for turn in turns if turn.round == 1]
    new = Snapshot({turn.cell: turn.new for turn in first if turn.new is not None})
    given = {turn.cell: turn.base for turn in first if turn.base is not None}
    expected = {
        cell: sample if _same(sample, new.samples.get(cell)) else given.get(cell, sample)
        for cell, sample in reference.samples.items()
    }
    found = judge(pair(Snapshot(expected), new))
    qualities = tuple(comparison for comparison in found.comparisons if not comparison.metric.is_cost)
    return Judgement((*qualities, *judge_costs(turns)), found.findings), new


def _same(one: Sample, two: Sample | None) -> bool:
    return two is not None and all(metric.value(one) == metric.value(two) for metric in QUALITIES)


def judge_costs(turns: Iterable[Turn]) -> tuple[Comparison, ...]:
    """Both costs of each setting of which both sides trained a cell to its end.

    A setting is *worse* if all of its interval is above the tolerated ratio, after two rounds or more; *no worse* if
    all of it is at most that; otherwise the turns *cannot tell*.
    """
    settings: dict[Setting, list[Turn]] = {}
    for turn in turns:
        settings.setdefault(turn.cell.setting, []).append(turn)
    found = (_compare(setting, metric, own) for metric in COSTS for setting, own in sorted(settings.items()))
    return tuple(comparison for comparison in found if comparison is not None)


def unclear(turns: Sequence[Turn]) -> set[Setting]:
    """The settings that need more turns: one of their costs cannot be told yet."""
    taken: dict[Setting, int] = {}
    for turn in turns:
        taken[turn.cell.setting] = taken.get(turn.cell.setting, 0) + 1
    open_ones = {found.setting for found in judge_costs(turns) if found.verdict == "cannot tell"}
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
    low, high = interval(sorted(gains.tolist()))
    verdict: Verdict = "cannot tell"
    if low >= -metric.tolerated:
        verdict = "no worse"
    elif high < -metric.tolerated and max(turn.round for turn in turns) >= ROUNDS:
        verdict = "worse"
    chance = float(special.bdtr(int(np.sum(gains >= -metric.tolerated)), len(gains), 0.5))
    middle = float(np.median(base)), float(np.median(new))
    gain, turned = float(np.median(gains)), tuple(gains.tolist())
    return Comparison(setting, metric, *middle, len(turned), gain, low, high, chance, verdict, turned)


def interval(ordered: Sequence[float]) -> tuple[float, float]:
    """The exact 95 % interval of the median of what these numbers, in rising order, were drawn from.

    With fewer than six numbers there is none: (-inf, inf).
    """
    number = len(ordered)
    cut = sum(float(special.bdtr(count, number, 0.5)) <= TAIL for count in range(number))
    return (float(ordered[cut - 1]), float(ordered[number - cut])) if cut else (-math.inf, math.inf)
