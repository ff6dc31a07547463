"""Tables of one cell: what its policies scored, and what it took."""

from __future__ import annotations

from collections.abc import Mapping

from stlbench.records.result import Measurement, Score
from stlbench.report.tables.table import Column, Table

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
