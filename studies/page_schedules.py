"""What schedules change on the split core: tasks that are learned, by template."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

import recorded
from recorded import Row, markdown

from stlbench_tasks.suite.templates import TEMPLATES

METHODS = ("raw", "funnel")
ENOUGH = 0.95
"""A task is learned if the policy satisfies it from this share of the random starts, in both seeds."""

_Learned = Mapping[str, set[str]]
"""Method -> the tasks that it learned in all of their seeds."""


def learned(rows: Iterable[Row], column: str = "satisfaction") -> dict[str, set[str]]:
    """The tasks that each method learned in both seeds, by the selected policy or another column's."""
    shares = dict[tuple[str, str], list[float]]()
    for row in rows:
        if row["status"] == "done":
            shares.setdefault((row["method"], row["task"]), []).append(float(row[column]))
    both = {key for key, values in shares.items() if len(values) >= 2 and min(values) >= ENOUGH}
    return {method: {task for own, task in both if own == method} for method in METHODS}


def table() -> str:
    """One row per template: how many tasks `raw`, `funnel`, or one of them learned, without schedules and with."""
    before = [row for row in recorded.table("suite-core", "cells") if row["method"] in METHODS]
    now = recorded.table("suite-schedules", "cells")
    found = [learned(before), learned(now), learned(now, "final_satisfaction")]
    longer = _longer(now)
    body = []
    for template in (*TEMPLATES, "all"):
        own = {row["task"] for row in now if template in (row["template"], "all")}
        counts = [_counts(each, own) for each in found]
        final = len((found[2]["raw"] | found[2]["funnel"]) & own)
        long = "" if longer is None else str(len(longer & own))
        body.append([f"`{template}`" if template in TEMPLATES else template, str(len(own)), *counts[:2], str(final), long])
    header = ["", "tasks", "without: `raw`, `funnel`, either", "with", "final policies, either", "longer, either"]
    return markdown(header, body, right=len(header) - 1)


def _counts(found: _Learned, tasks: set[str]) -> str:
    sets = [found[method] & tasks for method in METHODS]
    return ", ".join(str(len(each)) for each in (*sets, sets[0] | sets[1]))


def _longer(now: Iterable[Row]) -> set[str] | None:
    """The tasks learned by `quick`, or else by the longer budget; None where nothing was trained with it."""
    if not (Path(recorded.RESULTS) / "suite-schedules-long").is_dir():
        return None
    quick, long = learned(now), learned(recorded.table("suite-schedules-long", "cells"))
    return quick["raw"] | quick["funnel"] | long["raw"] | long["funnel"]
