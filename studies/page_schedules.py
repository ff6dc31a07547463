"""What schedules change on the split core: tasks that are learned, by template."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import recorded
from page_suite import form
from recorded import Row, markdown

from stlbench_tasks.suite.templates import TEMPLATES

METHODS = ("raw", "funnel", "funnel[variant=code]", "cfer", "flag", "bhnr")
ENOUGH = 0.95
"""A task is learned if the policy satisfies it from this share of the random starts, in both seeds."""


def learned(rows: Iterable[Row]) -> dict[str, set[str]]:
    """The tasks that each method learned in both seeds, by the selected policy."""
    shares = dict[tuple[str, str], list[float]]()
    for row in rows:
        if row["status"] == "done":
            shares.setdefault((row["method"], row["task"]), []).append(float(row["satisfaction"]))
    both = {key for key, values in shares.items() if len(values) >= 2 and min(values) >= ENOUGH}
    return {method: {task for own, task in both if own == method} for method in METHODS}


def table() -> str:
    """One row per template: the tasks that each method, and any of them, learned with schedules.

    Beside it what `raw` or `funnel` learned without a schedule, and with the longer budget too.
    """
    now = recorded.table("suite-schedules", "cells")
    selected = learned(now)
    before, more = (
        _any(learned(row for row in recorded.table(study, "cells") if row["method"] in METHODS[:2]))
        for study in ("suite-core", "suite-schedules-long")
    )
    longer = selected["raw"] | selected["funnel"] | more
    columns = (before, *selected.values(), _any(selected), longer)
    body = []
    for template in (*TEMPLATES, "all"):
        own = {row["task"] for row in now if template in (row["template"], "all")}
        counts = [str(len(each & own)) for each in (own, *columns)]
        text = ["all", ""] if template == "all" else [f"`{template}`", f"`{form(template)}`".replace("|", "\\|")]
        body.append([*text, *counts])
    header = ["template", "formula", "tasks", "without", *(f"`{name}`" for name in METHODS), "any", "longer"]
    return markdown(header, body, right=len(header) - 1)


def _any(found: Mapping[str, set[str]]) -> set[str]:
    return set[str]().union(*found.values())
