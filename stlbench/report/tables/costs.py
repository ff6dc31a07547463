"""What training took, and on which machine, with which versions it was done."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stlbench.report.statistics.intervals import Interval, mean_interval
from stlbench.report.tables.rows import SETTING, Group, setting_values
from stlbench.report.tables.table import Column, Table, Value


def time_table(groups: Sequence[Group]) -> Table:
    """What training took: one row per group."""
    columns = (
        *SETTING,
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
        "Means over seeds, with t intervals, cut at 0. 'Cell' is training, checkpoints and evaluation.",
        "Reward: CPU nanoseconds of the method's reward per step and copy, in a batch of 1024.",
    )
    return Table("Time", columns, tuple(_time_row(group) for group in groups), notes)


def _time_row(group: Group) -> tuple[Value, ...]:
    wall = group.values(lambda numbers: numbers.training_wall_seconds)
    cpu = group.values(lambda numbers: numbers.training_cpu_seconds)
    return (
        *setting_values(group),
        _mean(wall),
        seconds_interval(wall),
        _mean(cpu),
        seconds_interval(cpu),
        _mean(group.values(lambda numbers: numbers.cpu_seconds)),
        _mean(group.values(lambda numbers: numbers.env_steps)),
        _mean(group.values(lambda numbers: numbers.reward_nanoseconds)),
        _mean(group.values(lambda numbers: numbers.inputs_added)),
        ", ".join(sorted({row.jobs for row in group.rows if row.jobs and row.numbers})) or None,
        group.remarks or None,
    )


def seconds_interval(values: Sequence[float]) -> Interval | None:
    """Of the mean; it ends at 0, as nothing takes less: the intervals of two seeds are wide."""
    interval = mean_interval(values)
    return None if interval is None else Interval(max(interval.low, 0.0), interval.high)


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


_NO_VERSIONS = {"machine", "jobs", "time", "code", "task_folder", "load"}
_NO_VERSIONS |= {"training_calibration_seconds", "reward_calibration_seconds"}
"""What provenance holds beside versions of packages."""


def circumstances(groups: Sequence[Group]) -> Table:
    """Machine, versions, code, cells at a time, days, cells and CPU time: one row each; where cells differ, all."""
    rows = [row for group in groups for row in group.rows]
    values: dict[str, set[str]] = {}
    for row in rows:
        for name, value in row.provenance.items():
            values.setdefault(name, set()).add(value)
    texts = {name: "; ".join(sorted(several)) for name, several in values.items()}
    versions = ", ".join(f"{name} {texts[name]}" for name in sorted(texts.keys() - _NO_VERSIONS))
    seconds = sum(row.numbers.cpu_seconds for row in rows if row.numbers)
    ended = sum(row.numbers is not None for row in rows)
    parts = (part.partition(" ") for row in rows for part in row.provenance.get("code", "").split(", "))
    code = sorted({version for part, _, version in parts if part == "harness"})
    days = sorted({time.partition("T")[0] for time in values.get("time", ())})
    lines = {
        "machine": texts.get("machine", ""),
        "versions": versions,
        "code of stlbench": "; ".join(code),
        "cells at a time": texts.get("jobs", ""),
        "begun": days[0] if len(days) == 1 else " to ".join([*days[:1], *days[-1:]]),
        "cells": f"{len(rows)}, {ended} of them with a result",
        "CPU time": f"{_time(seconds)}, training and evaluation",
    }
    columns = (Column("what", right=False), Column("value", right=False))
    return Table("Circumstances", columns, tuple((name, text) for name, text in lines.items() if text))


def _time(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.1f} seconds"
    return f"{seconds / 60:.1f} minutes" if seconds < 3600 else f"{seconds / 3600:.2f} hours"
