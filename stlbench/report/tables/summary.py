"""The tables of a study, in the order in which a reader is shown them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from stlbench.report.tables.across import aggregates_table, fields, improvement_table
from stlbench.report.tables.alignment import align, alignment_table
from stlbench.report.tables.cells import unfinished_table
from stlbench.report.tables.comparisons import advice, compare, comparisons_table
from stlbench.report.tables.hand_controllers import controllers_table
from stlbench.report.tables.outside import outside
from stlbench.report.tables.overview import overview
from stlbench.report.tables.planned import best_known, split
from stlbench.report.tables.robustness import robustness_table
from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Table
from stlbench.report.tables.times import time_table

if TYPE_CHECKING:
    from stlbench.rollout.standards import Standard


def summary(
    groups: Sequence[Group], standards: Mapping[str, Standard], recorded: Sequence[Group] | None = None
) -> tuple[Table, ...]:
    """What a reader is shown. Of several tasks an overview; robustness, how methods differ, time; aggregates over three
    tasks or more; controllers, plans, accidents, if any.

    Args:
        groups: what is shown. What was planned is in the table of alignment alone.
        standards: of their tasks.
        recorded: these and others, to which plans are compared; `groups` where left out.
    """
    among = groups if recorded is None else recorded
    learned = split(groups)[0]
    tasks = {group.setting.task for group in learned}
    others = tuple(group for group in outside(among) if group.setting.task in tasks or group in groups)
    best = {task: value for task, value in best_known(among, standards).items() if task in tasks}
    found, field = compare(learned, standards, best), fields(learned, standards, best)
    first = (overview(learned, standards, best, advice(found)),) if len(tasks) > 1 else ()
    tables = (
        *first,
        aggregates_table(field),
        improvement_table(field),
        robustness_table(learned, best, standards, others),
        comparisons_table(found),
        controllers_table(standards),
        alignment_table(align(among, standards, groups)),
        time_table(learned),
        unfinished_table(groups),
    )
    return tuple(table for table in tables if table.rows)
