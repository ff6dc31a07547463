"""The whole comparison at a glance: one row per task, one column per method."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from stlbench.registry.choices import Choice
from stlbench.report.statistics.intervals import median, median_interval
from stlbench.report.tables.contests import Contest, contests, mark, mark_notes
from stlbench.report.tables.rows import LEARNED, Group
from stlbench.report.tables.table import Column, Learned, Table, Value

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard


def overview(
    groups: Sequence[Group],
    standards: Mapping[str, Standard],
    best: Mapping[Choice, float] | None = None,
    advice: Iterable[str] = (),
) -> Table:
    """The median robustness of every method on every task with its interval, and on how many seeds it was learned.

    Args:
        groups: of one or more tasks, agents, budgets and tracks, which are the rows.
        standards: what is known of the tasks, such as what their controllers get.
        best: the best known robustness of the tasks, where it is known.
        advice: lines to say below.
    """
    by_hand = any(standard.by_hand for standard in standards.values())
    methods = sorted({group.setting.method for group in groups})
    columns = (
        Column("task", right=False, shared=True),
        Column("agent", right=False, shared=True),
        Column("budget", right=False, shared=True),
        Column("track", right=False, shared=True),
        *([Column("by hand", digits=3)] if by_hand else []),
        *([Column("possible", digits=3)] if best else []),
        *(Column(str(method), digits=3, kind=Learned) for method in methods),
        Column("cell CPU", unit="s", digits=0, drop=1),
    )
    found = contests(groups)
    body = tuple(
        (
            *map(str, key),
            *([_by_hand(key[0], standards)] if by_hand else []),
            *([best.get(key[0])] if best else []),
            *_entries(contest, methods, standards),
            _cpu_seconds(contest),
        )
        for key, contest in found.items()
    )
    marks = mark_notes(mark(group, contest, standards) for contest in found.values() for group in contest)
    return Table("Overview", columns, body, (_NOTE, *marks, *advice))


_NOTE = (
    "Robustness of the selected policies: the median seed, with its 95 % interval, of five seeds or more. In "
    "parentheses the seeds that learned the task, with the selected policy and with the final one: the policy "
    f"satisfies the formula from at least {100 * LEARNED:.0f} % of the starts."
)


def _by_hand(task: Choice, standards: Mapping[str, Standard]) -> float | None:
    """What the controller of the task, or of the task that it is an ablation of, gets."""
    standard = standards.get(task.name)
    return standard.by_hand.mean if standard and standard.by_hand else None


def _entries(contest: Contest, methods: Iterable[Choice], standards: Mapping[str, Standard]) -> list[Value]:
    by_method = {group.setting.method: _learned(group, mark(group, contest, standards)) for group in contest}
    return [by_method.get(method) for method in methods]


def _learned(group: Group, marks: str) -> Value:
    """Where no seed finished, how they ended."""
    if not group.done:
        return ", ".join(sorted({row.status for row in group.rows}))
    values = group.values(lambda numbers: numbers.robustness_mean)
    low, high = median_interval(values) or (None, None)
    learned, final = sum(each.learned for each in group.done), sum(each.final_learned for each in group.done)
    return Learned(median(values), low, high, learned, final, group.tried, marks)


def _cpu_seconds(groups: Iterable[Group]) -> float | None:
    """Per cell, mean over all of them."""
    seconds = [numbers.cpu_seconds for group in groups for numbers in group.done]
    return float(np.mean(seconds)) if seconds else None
