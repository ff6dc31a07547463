"""The tables of a run, as text that is ready to be laid out: what to say. `formats` is how to write it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields

import numpy as np

from stlbench.report.statistics import Statistic, interval, iqm
from stlbench.report.tables.overview import overview
from stlbench.report.tables.rows import Group, Numbers, Row
from stlbench.report.tables.table import NOTHING, Column, Table, decimal
from stlbench.result import ACCIDENTS, Score

__all__ = ["cells", "controllers", "cost", "robustness", "summary", "unfinished"]

IDENTITY = (
    Column("task", right=False, shared=True),
    Column("method", right=False),
    Column("agent", right=False, shared=True),
    Column("budget", right=False, shared=True),
    Column("seeds", right=False),
)


def robustness(groups: Sequence[Group]) -> Table:
    """How well the trained policies satisfy the formula: one row a group, one column a further protocol."""
    further = sorted({name for group in groups for numbers in group.done for name in numbers.further})
    columns = (
        *IDENTITY,
        Column("mean robustness", "mean"),
        Column("IQM robustness", "IQM", drop=2),
        Column("IQM 95 % interval", drop=1),
        Column("worst start", drop=4),
        Column("satisfied [%]"),
        *(Column(name, drop=3) for name in further),
        Column("final robustness", "final mean", drop=5),
        Column("final satisfied [%]", "final sat. [%]", drop=5),
        Column("lost first", right=False, below=True),
        Column("remarks", right=False, below=True),
    )
    return Table("Robustness", columns, tuple(_robustness_row(group, further) for group in groups), _notes(further))


def _robustness_row(group: Group, further: Sequence[str]) -> tuple[str, ...]:
    values = group.values(lambda numbers: numbers.robustness_mean)
    return (
        *_identity(group),
        decimal(_mean(values)),
        decimal(_mean(values, iqm)),
        _interval(values, iqm, 3),
        decimal(min(group.values(lambda numbers: numbers.robustness_min), default=None)),
        _percent(_mean(group.values(lambda numbers: numbers.satisfaction))),
        *(decimal(_mean([found.further[name] for found in group.done if name in found.further])) for name in further),
        decimal(_mean(group.values(lambda numbers: numbers.final_robustness_mean))),
        _percent(_mean(group.values(lambda numbers: numbers.final_satisfaction))),
        _lost_first(group),
        group.remarks or NOTHING,
    )


def _notes(further: Sequence[str]) -> tuple[str, ...]:
    notes = [
        "Robustness is in the unit of the task's predicates: averaged over the starts of a seed, then over seeds.",
        "The policy is the checkpoint that did best on other starts; 'final' is the one at the end of training.",
        "IQM: interquartile mean; up to 3 seeds it equals the mean. Interval: percentile bootstrap over seeds.",
        "Worst start: minimum over starts and seeds. Lost first: what failing starts most often lost first.",
    ]
    if further:
        names = ", ".join(further)
        notes.append(f"Mean robustness under the task's further protocols (`stlbench show task NAME`): {names}.")
    return tuple(notes)


def controllers(scores: Mapping[str, Score]) -> Table:
    """How well the tasks' controllers by hand satisfy the formula: one row a task, from its score."""
    columns = (
        Column("task", right=False, shared=True),
        Column("mean robustness", "mean"),
        Column("worst start"),
        Column("satisfied [%]"),
    )
    rows = tuple(
        (task, decimal(score.mean), decimal(score.minimum), _percent(score.satisfaction))
        for task, score in scores.items()
    )
    note = "What a controller written by hand gets from the same starts, for comparison; it is no upper bound."
    return Table("Hand controllers", columns, rows, (note,))


def cost(groups: Sequence[Group]) -> Table:
    """What training took: one row a group."""
    columns = (
        *IDENTITY,
        Column("training wall [s]", "train wall [s]"),
        Column("wall 95 % interval [s]", drop=2),
        Column("training CPU [s]", "train CPU [s]"),
        Column("CPU 95 % interval [s]", drop=2),
        Column("cell CPU [s]", drop=5),
        Column("env steps"),
        Column("reward [ns/step]"),
        Column("inputs added", drop=3),
        Column("jobs at a time", drop=4),
        Column("remarks", right=False, below=True),
    )
    notes = (
        "Means over seeds, intervals by percentile bootstrap. 'Cell' is training, checkpoints and evaluation.",
        "Reward: CPU nanoseconds of the method's reward a step and copy, in a batch of 1024.",
    )
    return Table("Wall time and cost", columns, tuple(_cost_row(group) for group in groups), notes)


def _cost_row(group: Group) -> tuple[str, ...]:
    wall = group.values(lambda numbers: numbers.training_wall_seconds)
    cpu = group.values(lambda numbers: numbers.training_cpu_seconds)
    return (
        *_identity(group),
        decimal(_mean(wall), 1),
        _interval(wall, np.mean, 1),
        decimal(_mean(cpu), 1),
        _interval(cpu, np.mean, 1),
        decimal(_mean(group.values(lambda numbers: numbers.cpu_seconds)), 1),
        decimal(_mean(group.values(lambda numbers: numbers.env_steps)), 0),
        decimal(_mean(group.values(lambda numbers: numbers.reward_nanoseconds)), 1),
        decimal(_mean(group.values(lambda numbers: numbers.inputs_added)), 0),
        ", ".join(sorted({row.jobs for row in group.rows if row.jobs and row.numbers})) or NOTHING,
        group.remarks or NOTHING,
    )


def unfinished(groups: Iterable[Group]) -> Table:
    """The cells that ended by accident: raised, out of time, killed."""
    rows = [row for group in groups for row in group.rows if row.status in ACCIDENTS]
    columns = tuple(Column(title, right=False) for title in ("cell", "budget", "status", "reason"))
    cells = tuple((row.name, row.budget, row.status, row.reason or NOTHING) for row in rows)
    return Table("Cells without a result", columns, cells, ("`stlbench run --retry` runs them again.",))


def summary(groups: Sequence[Group], scores: Mapping[str, Score]) -> tuple[Table, ...]:
    """What a reader is shown: robustness and cost; an overview of several tasks; controllers and accidents, if any.

    `scores` are those of the controllers, by task.
    """
    first = (overview(groups, scores),) if len({group.task for group in groups}) > 1 else ()
    tables = (*first, robustness(groups), controllers(scores), cost(groups), unfinished(groups))
    return tuple(table for table in tables if table.rows)


CELL = ("task", "method", "agent", "seed", "budget", "status", "reason")
PLAIN = tuple(field.name for field in fields(Numbers) if field.name not in ("further", "first_failed", "curve"))


def cells(rows: Iterable[Row]) -> Table:
    """One row a cell with its numbers in full, for other programs."""
    columns = [Column(title, right=title == "seed") for title in CELL] + [Column(title) for title in PLAIN]
    return Table("Cells", tuple(columns), tuple(_cell(row) for row in rows))


def _cell(row: Row) -> tuple[str, ...]:
    numbers = [str(getattr(row.numbers, name)) if row.numbers else "" for name in PLAIN]
    return (row.task, row.method, row.agent, str(row.seed), row.budget, row.status, row.reason, *numbers)


def _identity(group: Group) -> tuple[str, ...]:
    return (group.task, group.method, group.agent, group.budget, group.seeds)


def _mean(values: Sequence[float], statistic: Callable[..., float] = np.mean) -> float | None:
    return float(statistic(values)) if values else None


def _percent(share: float | None) -> str:
    return NOTHING if share is None else decimal(100 * share, 1)


def _interval(values: Sequence[float], statistic: Statistic, digits: int) -> str:
    ends = interval(values, statistic)
    return NOTHING if ends is None else f"[{decimal(ends[0], digits)}, {decimal(ends[1], digits)}]"


def _lost_first(group: Group) -> str:
    if not group.failures:
        return NOTHING
    formula, count = group.failures[0]
    total = sum(count for _, count in group.failures)
    return f"{formula} ({decimal(100 * count / total, 0)} % of {total} failing starts)"
