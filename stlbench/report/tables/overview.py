"""The whole comparison at a glance: one row per task, one column per method."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from stlbench.registry.choices import Choice
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Column, Learned, Table, Value

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard

__all__ = ["LEARNED", "overview"]

LEARNED = 0.95
"""Share of the starts from which a policy that has learned the task satisfies the formula."""


def overview(
    groups: Sequence[Group], standards: Mapping[str, Standard], best: Mapping[Choice, float] | None = None
) -> Table:
    """Mean robustness of every method on every task, and on how many seeds it was learned.

    Args:
        groups: of one or more tasks, agents and budgets, which are the rows.
        standards: what is known of the tasks, such as what their controllers get.
        best: the best possible robustness of the tasks, where it is known.
    """
    by_hand = any(standard.by_hand for standard in standards.values())
    methods = sorted({group.setting.method for group in groups})
    rows: dict[tuple[Value, ...], dict[object, Group]] = {}
    for group in groups:
        setting = group.setting
        by_method = rows.setdefault((str(setting.task), str(setting.agent), setting.budget, setting.track), {})
        by_method[setting.method] = group
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
    body = tuple(
        (
            *row,
            *([_by_hand(by_method.values(), standards)] if by_hand else []),
            *([best.get(_task(by_method.values()))] if best else []),
            *(_learned(by_method.get(method)) for method in methods),
            _cpu_seconds(by_method.values()),
        )
        for row, by_method in rows.items()
    )
    note = (
        "Robustness of the selected policies, averaged over starts and seeds. In parentheses the seeds that learned "
        "the task, with the selected policy and with the final one: the policy satisfies the formula from at least "
        f"{100 * LEARNED:.0f} % of the starts."
    )
    return Table("Overview", columns, body, (note,))


def _by_hand(groups: Iterable[Group], standards: Mapping[str, Standard]) -> float | None:
    """What the controller of the task, or of the task that it is an ablation of, gets."""
    standard = standards.get(_task(groups).name)
    return standard.by_hand.mean if standard and standard.by_hand else None


def _task(groups: Iterable[Group]) -> Choice:
    return next(iter(groups)).setting.task


def _learned(group: Group | None) -> Value:
    """Where no seed finished, how they ended."""
    if group is None:
        return None
    if not group.done:
        return ", ".join(sorted({row.status for row in group.rows}))
    learned = sum(numbers.satisfaction >= LEARNED for numbers in group.done)
    final = sum(numbers.final_satisfaction >= LEARNED for numbers in group.done)
    mean = float(np.mean(group.values(lambda numbers: numbers.robustness_mean)))
    return Learned(mean, learned, final, len(group.rows))


def _cpu_seconds(groups: Iterable[Group]) -> float | None:
    """Per cell, mean over all of them."""
    seconds = [numbers.cpu_seconds for group in groups for numbers in group.done]
    return float(np.mean(seconds)) if seconds else None
