"""How the results of a report came about: machine, versions, CPU time."""

from __future__ import annotations

from collections.abc import Sequence

from stlbench.report.tables.rows import Group
from stlbench.report.tables.table import Column, Table
from stlbench.study.provenance import CODE, code_of

_CALIBRATIONS = {"training_calibration_seconds", "reward_calibration_seconds"}
_OTHERS = {"machine", "jobs", "time", CODE, "task_folder", "load"} | _CALIBRATIONS


def circumstances(groups: Sequence[Group]) -> Table:
    """Machine, versions, code, cells at a time, days, cells and CPU time: one row each; where cells differ, all."""
    rows = [row for group in groups for row in group.rows]
    values: dict[str, set[str]] = {}
    for row in rows:
        for name, value in row.provenance.items():
            values.setdefault(name, set()).add(value)
    said = {name: "; ".join(sorted(found)) for name, found in values.items()}
    versions = ", ".join(f"{name} {said[name]}" for name in sorted(said.keys() - _OTHERS))
    seconds = sum(row.numbers.cpu_seconds for row in rows if row.numbers)
    ended = sum(row.numbers is not None for row in rows)
    code = sorted({harness for row in rows if (harness := code_of(row.provenance).get("harness"))})
    days = sorted({time.partition("T")[0] for time in values.get("time", ())})
    lines = {
        "machine": said.get("machine", ""),
        "versions": versions,
        "code of stlbench": "; ".join(code),
        "cells at a time": said.get("jobs", ""),
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
