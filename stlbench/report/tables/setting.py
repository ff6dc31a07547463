"""The first columns of tables that have a row per group: what its cells have in common, and how many there are."""

from __future__ import annotations

from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Column, Seeds, Value

SETTING = (
    Column("task", right=False, shared=True),
    Column("method", right=False),
    Column("agent", right=False, shared=True),
    Column("budget", right=False, shared=True),
    Column("track", right=False, shared=True),
    Column("seeds", right=False, kind=Seeds),
)


def setting_values(group: Group) -> tuple[Value, ...]:
    """The values of a group in these columns."""
    setting = group.setting
    budget = "unknown" if group.outside else setting.budget
    return (str(setting.task), str(setting.method), str(setting.agent), budget, setting.track, group.seeds)
