"""A measurement as flat columns: the one mapping for ledgers, tables, logs and the gate."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from stlbench.records.result import Measurement, Score, reported

_NESTED = ("selected", "final", "curve", "planned", "policies")


def numbers(measurement: Measurement) -> dict[str, Any]:
    """All columns of a measurement.

    Scores are those that count (`reported`), of the selected policy and, with the prefix `final_`, of the final one:
    `robustness_mean`, `robustness_min`, `satisfaction` in [0, 1], `ended_early` and `starts`. The other columns are the
    fields of `Measurement` that are a single value, and `maximised` and `grid_value` of a policy that was planned.
    """
    columns = {each.name: getattr(measurement, each.name) for each in fields(Measurement) if each.name not in _NESTED}
    for prefix, scores in (("", measurement.selected), ("final_", measurement.final)):
        columns |= {f"{prefix}{name}": value for name, value in score_numbers(reported(scores)).items()}
    planned = measurement.planned
    return columns if planned is None else columns | {"maximised": planned.maximised, "grid_value": planned.value}


def score_numbers(score: Score) -> dict[str, float | int | None]:
    """A score as flat columns."""
    return {
        "robustness_mean": score.mean,
        "robustness_min": score.minimum,
        "satisfaction": score.satisfaction,
        "ended_early": score.ended_early,
        "starts": score.starts,
    }
