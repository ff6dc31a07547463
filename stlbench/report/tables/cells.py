"""Tables with a row per cell, and the tables of one cell."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields

from stlbench.records.identity import IDENTITY
from stlbench.records.result import Measurement, Score
from stlbench.records.status import ACCIDENTS
from stlbench.report.statistics.intervals import Interval, share_interval
from stlbench.report.tables.rows import Group, Numbers, Row
from stlbench.report.tables.table import Column, Table, Value

_PARTS = ("planned", "further", "first_failed", "curve", "starts", "extension", "ended_early")
_NUMBERS = tuple(field.name for field in fields(Numbers) if field.name not in _PARTS)

_OF_STARTS = (
    Column("starts"),
    Column("satisfaction 95 % interval", kind=Interval),
    Column("final_satisfaction 95 % interval", kind=Interval),
    Column("extension"),
    Column("ended_early"),
)
_PLANS = (Column("maximised"), Column("grid_value"))


def cells_table(rows: Iterable[Row]) -> Table:
    """One row per cell with its numbers, for other programs; where any was planned, also what its plan says."""
    listed = list(rows)
    planned = any(row.numbers and row.numbers.planned for row in listed)
    columns = [Column(title, right=title == "seed") for title in (*IDENTITY, "status", "reason")]
    columns += [*map(Column, _NUMBERS), *_OF_STARTS, *(_PLANS if planned else ())]
    return Table("Cells", tuple(columns), tuple((*_cell(row), *(_plan(row) if planned else ())) for row in listed))


def _cell(row: Row) -> tuple[Value, ...]:
    cell, numbers = row.id, row.numbers
    return (
        *(str(cell.task), str(cell.method), str(cell.agent), cell.seed, cell.budget, cell.track),
        *(row.status, row.reason or None),
        *(None if numbers is None else getattr(numbers, name) for name in _NUMBERS),
        *((None,) * len(_OF_STARTS) if numbers is None else _of_starts(numbers)),
    )


def _of_starts(numbers: Numbers) -> tuple[Value, ...]:
    """How many starts, and the exact intervals of the shares that satisfy, for this one policy."""
    starts = numbers.starts
    ends = [
        share_interval(round(share * starts), starts) if starts else None
        for share in (numbers.satisfaction, numbers.final_satisfaction)
    ]
    return (starts, *ends, numbers.extension or None, numbers.ended_early)


def _plan(row: Row) -> tuple[Value, ...]:
    planned = row.numbers.planned if row.numbers else None
    return (None, None) if planned is None else (planned.maximised, planned.value)


def unfinished_table(groups: Iterable[Group]) -> Table:
    """The cells that ended by accident: raised, out of time, killed."""
    rows = [row for group in groups for row in group.rows if row.status in ACCIDENTS]
    columns = tuple(Column(title, right=False) for title in ("cell", "budget", "status", "reason"))
    cells = tuple((row.id.name, row.id.budget, row.status, row.reason or None) for row in rows)
    return Table("Cells without a result", columns, cells, ("`stlbench run --retry failed` runs them again.",))


ENDED_EARLY = (
    "Ended early: share of the starts whose episode the environment ended before the formula's horizon. The task's "
    "`terminated` says how such an episode is judged: under `hold` the last sample stays, so an early end can satisfy."
)
"""The note on the column of that name."""


def scores_table(policies: Mapping[str, Mapping[str, Score]]) -> Table:
    """One row per protocol and policy, from the scores of policies by name; of a single one without a name no name."""
    early = any(score.ended_early for scores in policies.values() for score in scores.values())
    columns = (
        Column("protocol", right=False),
        *([Column("policy", right=False)] if any(policies) else []),
        Column("mean robustness", "mean", digits=3),
        Column("worst start", digits=3),
        Column("satisfied", unit="%", digits=1),
        *([Column("ended early", unit="%", digits=1)] if early else []),
        Column("starts", digits=0),
        Column("failed first", right=False),
    )
    rows = tuple(
        (
            protocol,
            *([policy] if any(policies) else []),
            *(score.mean, score.minimum, 100 * score.satisfaction),
            *([None if score.ended_early is None else 100 * score.ended_early] if early else []),
            score.starts,
            "\n".join(f"{formula}: {count}" for formula, count in score.first_failed.items()) or None,
        )
        for protocol in next(iter(policies.values()))
        for policy, scores in policies.items()
        for score in [scores[protocol]]
    )
    return Table("Scores", columns, rows, (ENDED_EARLY,) if early else ())


def cost_table(measurement: Measurement) -> Table:
    """What the cell took, one row per number."""
    columns = (Column("what", right=False), Column("value"))
    names = {
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
    return Table("Cost", columns, tuple(names.items()))
