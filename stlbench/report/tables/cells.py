"""Tables of cells: one row for each cell, the numbers of one cell, and what training took on which machine."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields
from operator import attrgetter

from stlbench.records.identity import IDENTITY
from stlbench.records.result import Measurement, Score
from stlbench.records.status import ACCIDENTS
from stlbench.report.tables.rows import SETTING, Group, Numbers, Row
from stlbench.report.tables.table import Column, Table, Value
from stlbench.statistics.intervals import Interval, mean_interval, share_interval

_APART = ("planned", "further", "first_failed", "curve", "starts", "extension", "ended_early")
"""The values without a column, or with one of the last."""


CELL: Mapping[Column, Callable[[Row], Value]] = {
    Column("cell", right=False): lambda row: row.id.name,
    Column("budget", right=False): lambda row: row.id.budget,
    Column("status", right=False): lambda row: row.status,
    Column("reason", right=False): lambda row: row.reason or None,
}
"""The columns that say which cell a row is, and how it ended."""
_IDENTITY: Mapping[Column, Callable[[Row], Value]] = {
    Column(name, right=name == "seed"): lambda row, name=name: row.id.plain[name]  # type: ignore[misc]
    for name in IDENTITY
}


def cells_table(rows: Iterable[Row], groups: Mapping[str, Mapping[str, str]] | None = None) -> Table:
    """One row for each cell with its numbers, for other programs. If any was planned, also what its plan says.

    `groups` are those of tasks that a suite drew, such as system and template, by the task's name.
    """
    listed, of_tasks = list(rows), groups or {}
    kinds = dict.fromkeys(kind for row in listed for kind in of_tasks.get(row.id.task.name, ()))
    of_numbers: dict[Column, Callable[[Numbers], Value]] = {
        **{Column(each.name): attrgetter(each.name) for each in fields(Numbers) if each.name not in _APART},
        Column("starts"): lambda each: each.starts,
        Column("satisfaction 95 % interval", kind=Interval): lambda each: _of_starts(each.satisfaction, each),
        Column("final_satisfaction 95 % interval", kind=Interval): (
            lambda each: _of_starts(each.final_satisfaction, each)
        ),
        Column("extension"): lambda each: each.extension or None,
        Column("ended_early"): lambda each: each.ended_early,
    }
    if any(row.numbers and row.numbers.planned for row in listed):
        of_numbers[Column("maximised")] = lambda each: each.planned.maximised if each.planned else None
        of_numbers[Column("grid_value")] = lambda each: each.planned.value if each.planned else None
    of_cell = {column: value for column, value in CELL.items() if column.title in ("status", "reason")}
    drawn = {
        Column(kind, right=False): lambda row, kind=kind: of_tasks.get(row.id.task.name, {}).get(kind) for kind in kinds
    }
    return Table.of("Cells", listed, {**_IDENTITY, **drawn, **of_cell, **if_done(of_numbers)})


def if_done(columns: Mapping[Column, Callable[[Numbers], Value]]) -> dict[Column, Callable[[Row], Value]]:
    """Columns of cells; a cell without numbers has None."""

    def of_row(value: Callable[[Numbers], Value]) -> Callable[[Row], Value]:
        return lambda row: None if row.numbers is None else value(row.numbers)

    return {column: of_row(value) for column, value in columns.items()}


def percent(share: float | None) -> float | None:
    return None if share is None else 100 * share


def _of_starts(share: float, numbers: Numbers) -> Interval | None:
    """The exact interval of a share of the starts, for this one policy."""
    return share_interval(round(share * numbers.starts), numbers.starts) if numbers.starts else None


def unfinished_table(groups: Iterable[Group]) -> Table:
    """The cells that ended by accident: raised, out of time, killed."""
    rows = [row for group in groups for row in group.rows if row.status in ACCIDENTS]
    return Table.of("Cells without a result", rows, CELL, ("`stlbench run --retry failed` runs them again.",))


ENDED_EARLY = (
    "Ended early: share of the starts whose episode the environment ended before the formula's horizon. The task's "
    "`terminated` says how such an episode is judged: under `hold` the last sample stays, so an early end can satisfy."
)
"""The note on the column of that name."""


def scores_table(policies: Mapping[str, Mapping[str, Score]]) -> Table:
    """One row for each protocol and policy, from name -> protocol -> score. A single policy may have an empty name."""
    early = any(score.ended_early for scores in policies.values() for score in scores.values())
    columns: dict[Column, Callable[[tuple[str, str, Score]], Value]] = {
        Column("protocol", right=False): lambda row: row[0],
        Column("policy", right=False): lambda row: row[1],
        Column("mean robustness", "mean", digits=3): lambda row: row[2].mean,
        Column("worst start", digits=3): lambda row: row[2].minimum,
        Column("satisfied", unit="%", digits=1): lambda row: 100 * row[2].satisfaction,
        Column("ended early", unit="%", digits=1): lambda row: percent(row[2].ended_early),
        Column("starts", digits=0): lambda row: row[2].starts,
        Column("failed first", right=False): (
            lambda row: "\n".join(f"{formula}: {count}" for formula, count in row[2].first_failed.items()) or None
        ),
    }
    shown = {"policy": any(policies), "ended early": early}
    columns = {column: value for column, value in columns.items() if shown.get(column.title, True)}
    protocols = next(iter(policies.values()))
    rows = [(protocol, name, scores[protocol]) for protocol in protocols for name, scores in policies.items()]
    return Table.of("Scores", rows, columns, (ENDED_EARLY,) if early else ())


def scores_and_cost(measurement: Measurement, *, outside: bool) -> list[Table]:
    """The tables of one cell. A policy from outside has one score, and no cost."""
    if outside:
        return [scores_table({"": measurement.selected})]
    cost = {
        "selected at environment step": measurement.selected_steps,
        "environment steps": measurement.env_steps,
        "checkpoints": len(measurement.curve),
        "training CPU [s]": measurement.training_cpu_seconds,
        "training wall [s]": measurement.training_wall_seconds,
        "cell CPU [s]": measurement.cpu_seconds,
        "cell wall [s]": measurement.wall_seconds,
        "reward [ns/step]": measurement.reward_nanoseconds,
        "inputs added": measurement.inputs_added,
    }
    return [
        scores_table({"selected": measurement.selected, "final": measurement.final}),
        Table("Cost", (Column("what", right=False), Column("value")), tuple(cost.items())),
    ]


def time_table(groups: Sequence[Group]) -> Table:
    columns: dict[Column, Callable[[Group], Value]] = {
        **SETTING,
        Column("training wall", "train wall", unit="s", digits=1): lambda group: group.mean("training_wall_seconds"),
        Column("wall 95 % interval", unit="s", digits=1, kind=Interval, drop=2): _interval_of("training_wall_seconds"),
        Column("training CPU", "train CPU", unit="s", digits=1): lambda group: group.mean("training_cpu_seconds"),
        Column("CPU 95 % interval", unit="s", digits=1, kind=Interval, drop=2): _interval_of("training_cpu_seconds"),
        Column("cell CPU", unit="s", digits=1, drop=5): lambda group: group.mean("cpu_seconds"),
        Column("env steps", digits=0): lambda group: group.mean("env_steps"),
        Column("reward", unit="ns/step", digits=1): lambda group: group.mean("reward_nanoseconds"),
        Column("inputs added", digits=0, drop=3): lambda group: group.mean("inputs_added"),
        Column("jobs at a time", drop=4): _jobs,
        Column("remarks", right=False, below=True): lambda group: group.remarks or None,
    }
    notes = (
        "Means over seeds, with t intervals, cut at 0. 'Cell' is training, checkpoints and evaluation.",
        "Reward: CPU nanoseconds of the method's reward per step and copy, in a batch of 1024.",
    )
    return Table.of("Time", groups, columns, notes)


def _interval_of(name: str) -> Callable[[Group], Value]:
    """The interval of the mean, cut at 0: the interval of two seeds is wide."""
    return lambda group: (ends := mean_interval(group.values(name))) and Interval(max(ends.low, 0.0), ends.high)


def _jobs(group: Group) -> str | None:
    jobs = {row.provenance.get("jobs", "") for row in group.rows if row.numbers}
    return ", ".join(sorted(jobs - {""})) or None


_NO_VERSIONS = {"machine", "jobs", "time", "code", "task_folder", "load"}
_NO_VERSIONS |= {"training_calibration_seconds", "reward_calibration_seconds"}
"""Keys of provenance that are no versions of packages."""


def circumstances(groups: Sequence[Group]) -> Table:
    """Machine, versions, code, jobs, days, cells and CPU time: one row each. If cells differ, it has all values."""
    rows = [row for group in groups for row in group.rows]
    values: dict[str, set[str]] = {}
    for row in rows:
        for name, value in row.provenance.items():
            values.setdefault(name, set()).add(value)
    texts = {name: "; ".join(sorted(several)) for name, several in values.items()}
    parts = (part.partition(" ") for row in rows for part in row.provenance.get("code", "").split(", "))
    days = sorted({time.partition("T")[0] for time in values.get("time", ())})
    seconds = sum(row.numbers.cpu_seconds for row in rows if row.numbers)
    lines = {
        "machine": texts.get("machine", ""),
        "versions": ", ".join(f"{name} {texts[name]}" for name in sorted(texts.keys() - _NO_VERSIONS)),
        "code of stlbench": "; ".join(sorted({version for part, _, version in parts if part == "harness"})),
        "cells at a time": texts.get("jobs", ""),
        "begun": days[0] if len(days) == 1 else " to ".join([*days[:1], *days[-1:]]),
        "cells": f"{len(rows)}, {sum(row.numbers is not None for row in rows)} of them with a result",
        "CPU time": f"{_time(seconds)}, training and evaluation",
    }
    columns = (Column("what", right=False), Column("value", right=False))
    return Table("Circumstances", columns, tuple((name, text) for name, text in lines.items() if text))


def _time(seconds: float) -> str:
    if seconds < 60:
        return f"{seconds:.1f} seconds"
    return f"{seconds / 60:.1f} minutes" if seconds < 3600 else f"{seconds / 3600:.2f} hours"
