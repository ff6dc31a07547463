"""The tables of a study, as values: what to say. `formats` is how to write it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING

import numpy as np

from stlbench.registry.choices import Choice
from stlbench.report.statistics.intervals import Interval, interval, iqm
from stlbench.report.tables.alignment import align, alignment_table
from stlbench.report.tables.overview import overview
from stlbench.report.tables.planned import best_possible, split
from stlbench.report.tables.rows import Group, Numbers, Row
from stlbench.report.tables.table import Column, FirstFailed, Seeds, Table, Value
from stlbench.result import ACCIDENTS, IDENTITY

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard

__all__ = ["cells_table", "controllers_table", "robustness_table", "summary", "time_table", "unfinished_table"]

_SETTING = (
    Column("task", right=False, shared=True),
    Column("method", right=False),
    Column("agent", right=False, shared=True),
    Column("budget", right=False, shared=True),
    Column("track", right=False, shared=True),
    Column("seeds", right=False, kind=Seeds),
)


def robustness_table(groups: Sequence[Group], best: Mapping[Choice, float] | None = None) -> Table:
    """How well the trained policies satisfy the formula: one row per group, one column per further protocol.

    `best` is the best possible of their tasks (`best_possible`); where any is known, robustness is also a share of it.
    """
    further = sorted({name for group in groups for numbers in group.done for name in numbers.further})
    columns = (
        *_SETTING,
        Column("mean robustness", "mean", digits=3),
        Column("IQM robustness", "IQM", digits=3, drop=2),
        Column("IQM 95 % interval", digits=3, kind=Interval, drop=1),
        Column("worst start", digits=3, drop=4),
        Column("satisfied", unit="%", digits=1),
        *([Column(_NORMALISED, "normalised", digits=2, drop=2)] if best else []),
        *(Column(name, digits=3, drop=3) for name in further),
        Column("final robustness", "final mean", digits=3, drop=5),
        Column("final satisfied", "final sat.", unit="%", digits=1, drop=5),
        Column("failed first", kind=FirstFailed, right=False, below=True),
        Column("remarks", right=False, below=True),
    )
    rows = tuple(_robustness_row(group, further, best or {}) for group in groups)
    return Table("Robustness", columns, rows, _notes(further))


_NORMALISED = "normalised (mean / best possible, both above 0)"


def _robustness_row(group: Group, further: Sequence[str], best: Mapping[Choice, float]) -> tuple[Value, ...]:
    values = group.values(lambda numbers: numbers.robustness_mean)
    return (
        *_setting(group),
        _mean(values),
        iqm(values) if values else None,
        interval(values),
        min(group.values(lambda numbers: numbers.robustness_min), default=None),
        _percent(group.values(lambda numbers: numbers.satisfaction)),
        *([_share(_mean(values), best.get(group.setting.task))] if best else []),
        *(_mean([numbers.further[name] for numbers in group.done if name in numbers.further]) for name in further),
        _mean(group.values(lambda numbers: numbers.final_robustness_mean)),
        _percent(group.values(lambda numbers: numbers.final_satisfaction)),
        group.first_failed,
        group.remarks or None,
    )


def _share(mean: float | None, best: float | None) -> float | None:
    """Robustness as a share of the best possible; None where it says nothing, as of what violates."""
    return mean / best if mean is not None and best is not None and mean > 0 < best else None


def _notes(further: Sequence[str]) -> tuple[str, ...]:
    notes = [
        "Robustness is in the unit of the task's predicates: averaged over the starts of a seed, then over seeds.",
        "The policy is the checkpoint that did best on other starts; 'final' is the one at the end of training.",
        "IQM: interquartile mean; up to 3 seeds it equals the mean. Interval: of the IQM, by Student's t over seeds.",
        "Worst start: minimum over starts and seeds. Failed first: what violating starts most often failed first.",
    ]
    if further:
        names = ", ".join(further)
        notes.append(f"Mean robustness under the task's further protocols (`stlbench show task NAME`): {names}.")
    return tuple(notes)


def controllers_table(standards: Mapping[str, Standard]) -> Table:
    """How well the tasks' controllers by hand satisfy the formula, and what is possible: one row per task."""
    known = {task: each for task, each in standards.items() if each.by_hand or each.best_possible}
    best = any(standard.best_possible for standard in known.values())
    columns = (
        Column("task", right=False, shared=True),
        Column("mean robustness", "mean", digits=3),
        Column("worst start", digits=3),
        Column("satisfied", unit="%", digits=1),
        *(Column(title, short, digits=3) for title, short in (_BEST if best else {}).items()),
    )
    rows = tuple((task, *_by_hand(standard), *(_best(standard) if best else ())) for task, standard in known.items())
    notes = ["What a controller written by hand gets from the same starts, for comparison; it is no upper bound."]
    if best:
        notes.append("Best possible: reached by a plan for the formula; expected by it; reached on a coarser grid.")
    return Table("Hand controllers", columns, rows, tuple(notes))


_BEST = {"best_possible": "best possible", "grid_value": "grid value", "coarser": "coarser grid"}


def _by_hand(standard: Standard) -> tuple[Value, ...]:
    score = standard.by_hand
    return (None, None, None) if score is None else (score.mean, score.minimum, 100 * score.satisfaction)


def _best(standard: Standard) -> tuple[Value, ...]:
    best = standard.best_possible
    return (None, None, None) if best is None else (best.reached, best.value, best.coarser)


def time_table(groups: Sequence[Group]) -> Table:
    """What training took: one row per group."""
    columns = (
        *_SETTING,
        Column("training wall", "train wall", unit="s", digits=1),
        Column("wall 95 % interval", unit="s", digits=1, kind=Interval, drop=2),
        Column("training CPU", "train CPU", unit="s", digits=1),
        Column("CPU 95 % interval", unit="s", digits=1, kind=Interval, drop=2),
        Column("cell CPU", unit="s", digits=1, drop=5),
        Column("env steps", digits=0),
        Column("reward", unit="ns/step", digits=1),
        Column("inputs added", digits=0, drop=3),
        Column("jobs at a time", drop=4),
        Column("remarks", right=False, below=True),
    )
    notes = (
        "Means over seeds, with t intervals. 'Cell' is training, checkpoints and evaluation.",
        "Reward: CPU nanoseconds of the method's reward per step and copy, in a batch of 1024.",
    )
    return Table("Time", columns, tuple(_time_row(group) for group in groups), notes)


def _time_row(group: Group) -> tuple[Value, ...]:
    wall = group.values(lambda numbers: numbers.training_wall_seconds)
    cpu = group.values(lambda numbers: numbers.training_cpu_seconds)
    return (
        *_setting(group),
        _mean(wall),
        interval(wall, cut=0),
        _mean(cpu),
        interval(cpu, cut=0),
        _mean(group.values(lambda numbers: numbers.cpu_seconds)),
        _mean(group.values(lambda numbers: numbers.env_steps)),
        _mean(group.values(lambda numbers: numbers.reward_nanoseconds)),
        _mean(group.values(lambda numbers: numbers.inputs_added)),
        ", ".join(sorted({row.jobs for row in group.rows if row.jobs and row.numbers})) or None,
        group.remarks or None,
    )


def unfinished_table(groups: Iterable[Group]) -> Table:
    """The cells that ended by accident: raised, out of time, killed."""
    rows = [row for group in groups for row in group.rows if row.status in ACCIDENTS]
    columns = tuple(Column(title, right=False) for title in ("cell", "budget", "status", "reason"))
    cells = tuple((row.id.name, row.id.budget, row.status, row.reason or None) for row in rows)
    return Table("Cells without a result", columns, cells, ("`stlbench run --retry` runs them again.",))


def summary(
    groups: Sequence[Group], standards: Mapping[str, Standard], recorded: Sequence[Group] | None = None
) -> tuple[Table, ...]:
    """What a reader is shown: robustness and time; an overview of several tasks; controllers, plans, accidents, if any.

    Args:
        groups: what is shown. What was planned is in the table of alignment alone.
        standards: of their tasks.
        recorded: these and others, to which plans are compared; `groups` where left out.
    """
    among = groups if recorded is None else recorded
    learned = split(groups)[0]
    tasks = {group.setting.task for group in learned}
    best = {task: value for task, value in best_possible(among, standards).items() if task in tasks}
    first = (overview(learned, standards, best),) if len(tasks) > 1 else ()
    tables = (
        *first,
        robustness_table(learned, best),
        controllers_table(standards),
        alignment_table(align(among, standards, groups)),
        time_table(learned),
        unfinished_table(groups),
    )
    return tuple(table for table in tables if table.rows)


_PARTS = ("planned", "further", "first_failed", "curve")
_NUMBERS = tuple(field.name for field in fields(Numbers) if field.name not in _PARTS)
_PLANNED = ("maximised", "grid_value")


def cells_table(rows: Iterable[Row]) -> Table:
    """One row per cell with its numbers, for other programs; where any was planned, also what its plan says."""
    listed = list(rows)
    planned = any(row.numbers and row.numbers.planned for row in listed)
    columns = [Column(title, right=title == "seed") for title in (*IDENTITY, "status", "reason")]
    columns += [Column(title) for title in (*_NUMBERS, *(_PLANNED if planned else ()))]
    return Table("Cells", tuple(columns), tuple((*_cell(row), *(_plan(row) if planned else ())) for row in listed))


def _cell(row: Row) -> tuple[Value, ...]:
    cell = row.id
    numbers = [None if row.numbers is None else getattr(row.numbers, name) for name in _NUMBERS]
    return (
        *(str(cell.task), str(cell.method), str(cell.agent), cell.seed, cell.budget, cell.track),
        *(row.status, row.reason or None, *numbers),
    )


def _plan(row: Row) -> tuple[Value, ...]:
    planned = row.numbers.planned if row.numbers else None
    return (None, None) if planned is None else (planned.maximised, planned.value)


def _setting(group: Group) -> tuple[Value, ...]:
    setting = group.setting
    return (str(setting.task), str(setting.method), str(setting.agent), setting.budget, setting.track, group.seeds)


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _percent(shares: Sequence[float]) -> float | None:
    return 100 * float(np.mean(shares)) if shares else None
