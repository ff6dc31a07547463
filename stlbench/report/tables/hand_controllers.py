"""What the policies of each task are compared with: its controller, actions at random, what is possible."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from stlbench.report.tables.table import Column, Table, Value

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard

__all__ = ["controllers_table"]


def controllers_table(standards: Mapping[str, Standard]) -> Table:
    """How well the tasks' controllers by hand satisfy the formula, actions at random, and what is possible.

    One row per task that has a controller, or of which it is known what is possible.
    """
    known = {task: each for task, each in standards.items() if each.by_hand or each.best_possible}
    at_random = any(standard.at_random for standard in known.values())
    best = any(standard.best_possible for standard in known.values())
    columns = (
        Column("task", right=False, shared=True),
        Column("mean robustness", "mean", digits=3),
        Column("worst start", digits=3),
        Column("satisfied", unit="%", digits=1),
        *(_AT_RANDOM if at_random else ()),
        *(Column(title, short, digits=3) for title, short in (_BEST if best else {}).items()),
    )
    rows = tuple(
        (
            task,
            *_by_hand(standard),
            *(_at_random(standard) if at_random else ()),
            *(_best(standard) if best else ()),
        )
        for task, standard in known.items()
    )
    notes = [
        "What a controller written by hand gets from the grid of report starts, for comparison; it is no upper bound."
    ]
    if at_random:
        notes.append("At random: what actions get that are drawn evenly from all, anew at each decision.")
    if best:
        notes.append("Best possible: reached by a plan for the formula; expected by it; reached on a coarser grid.")
    return Table("Hand controllers", columns, rows, tuple(notes))


_AT_RANDOM = (Column("at random", digits=3), Column("at random satisfied", "random sat.", unit="%", digits=1))
_BEST = {"best_possible": "best possible", "grid_value": "grid value", "coarser": "coarser grid"}


def _by_hand(standard: Standard) -> tuple[Value, ...]:
    score = standard.by_hand
    return (None, None, None) if score is None else (score.mean, score.minimum, 100 * score.satisfaction)


def _at_random(standard: Standard) -> tuple[Value, ...]:
    score = standard.at_random
    return (None, None) if score is None else (score.mean, 100 * score.satisfaction)


def _best(standard: Standard) -> tuple[Value, ...]:
    best = standard.best_possible
    return (None, None, None) if best is None else (best.reached, best.value, best.coarser)
