"""The whole comparison at a glance: a row a task, a column a method."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from stlbench.registry.choices import base_name
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import NOTHING, Column, Table, decimal
from stlbench.result import Score

__all__ = ["LEARNED", "overview"]

LEARNED = 0.95
"""Share of the starts from which a policy that has learned the task satisfies the formula."""


def overview(groups: Sequence[Group], scores: Mapping[str, Score]) -> Table:
    """Mean robustness of every method on every task, and on how many seeds it was learned.

    Args:
        groups: of one or more tasks, agents and budgets, which are the rows.
        scores: of the tasks' controllers by hand.
    """
    methods = sorted({group.method for group in groups})
    found = {((group.task, group.agent, group.budget), group.method): group for group in groups}
    rows = dict.fromkeys(row for row, _ in found)
    columns = (
        Column("task", right=False, shared=True),
        Column("agent", right=False, shared=True),
        Column("budget", right=False, shared=True),
        *([Column("by hand")] if scores else []),
        *(Column(method) for method in methods),
        Column("cell CPU [s]", drop=1),
    )
    body = tuple(
        (
            *row,
            *([_by_hand(row[0], scores)] if scores else []),
            *(_said(found.get((row, method))) for method in methods),
            _cost(group for (key, _), group in found.items() if key == row),
        )
        for row in rows
    )
    note = (
        "Robustness, averaged over starts and seeds. In parentheses the seeds that learned the task: "
        f"their policy satisfies the formula from at least {100 * LEARNED:.0f} % of the starts."
    )
    return Table("Overview", columns, body, (note,))


def _by_hand(task: str, scores: Mapping[str, Score]) -> str:
    score = scores.get(base_name(task))
    return NOTHING if score is None else decimal(score.mean)


def _said(group: Group | None) -> str:
    """0.396 (5/5); where no seed finished, how they ended."""
    if group is None:
        return NOTHING
    if not group.done:
        return ", ".join(sorted({row.status for row in group.rows}))
    learned = sum(numbers.satisfaction >= LEARNED for numbers in group.done)
    mean = float(np.mean(group.values(lambda numbers: numbers.robustness_mean)))
    return f"{decimal(mean)} ({learned}/{len(group.rows)})"


def _cost(groups: Iterable[Group]) -> str:
    """CPU seconds a cell, mean over all of them."""
    seconds = [numbers.cpu_seconds for group in groups for numbers in group.done]
    return decimal(float(np.mean(seconds)) if seconds else None, 0)
