"""What schedules change on the suite: learned tasks of core by template, and of the quick slice by method."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import recorded
from page_suite import form
from recorded import Row, markdown

from stlbench_tasks.suite.templates import TEMPLATES

METHODS = ("raw", "funnel", "funnel[variant=code]", "bhnr", "counters", "cfer", "dense", "flag")
SEEDS = ("0", "1")
ENOUGH = 0.95
"""A task is learned if the policy satisfies it from this share of the random starts, in both seeds."""


def learned(rows: Iterable[Row], methods: Iterable[str] = METHODS) -> dict[str, set[str]]:
    """The tasks that each method learned in both seeds, by the selected policy."""
    shares = dict[tuple[str, str], list[float]]()
    for row in rows:
        if row["status"] == "done" and row["seed"] in SEEDS:
            shares.setdefault((row["method"], row["task"]), []).append(float(row["satisfaction"]))
    both = {key for key, values in shares.items() if len(values) == len(SEEDS) and min(values) >= ENOUGH}
    return {method: {task for own, task in both if own == method} for method in methods}


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


def quick() -> str:
    """One row per method: the tasks of the quick slice that it learned without a schedule and with one, the best first.

    The runs without one are of earlier rules.
    """
    before = recorded.table("suite-quick", "cells")
    tasks = {row["task"] for row in before}
    names = tuple(dict.fromkeys([*METHODS, *(row["method"] for row in before)]))
    studies = ("suite-schedules", "suite-quick-schedules")
    now = [row for study in studies for row in recorded.table(study, "cells") if row["task"] in tasks]
    without, found = learned(before, names), learned(now, names)
    body = []
    for name in sorted(names, key=lambda name: -len(found[name])):
        fits = {row["task"] for row in before if row["method"] == name and row["status"] == "done"}
        body.append(
            [f"`{name}`", *([str(len(fits)), str(len(without[name]))] if fits else ["", ""]), str(len(found[name]))]
        )
    return markdown([f"of {len(tasks)} tasks", "fits without", "learned without", "with"], body, right=3)


def _any(found: Mapping[str, set[str]]) -> set[str]:
    return set[str]().union(*found.values())
