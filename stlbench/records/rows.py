"""A result as flat columns, for tables, logs and the gate; and a row of a ledger, with its checksums."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, Self, cast, get_args

from stlbench.records.identity import CellId, Track
from stlbench.records.outputs import cell_files
from stlbench.records.result import Measurement, Result, Score, from_json, reported, to_json
from stlbench.records.status import Status
from stlbench.registry.choices import parse_choice

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


_NUMBERS = ("robustness_mean", "satisfaction", "training_cpu_seconds", "training_wall_seconds")
"""Columns for queries by SQL."""


class Row(NamedTuple):
    number: int  # rows that were recorded later have greater numbers
    key: str
    status: Status
    failures: int  # how often in a row the cell has failed
    again: bool  # whether the next run measures the cell
    cell: CellId

    @classmethod
    def of(cls, number: int, key: str, status: Status, failures: int, again: int, *identity: str | int) -> Self:
        """From a rowid and the columns `LISTED`. Raises `ValueError` if they are damaged."""
        if status not in get_args(Status):
            raise ValueError(f"no status {status!r:.80}")
        return cls(number, key, status, failures, bool(again), cell_of(*identity))


def cell_of(*identity: str | int) -> CellId:
    """The cell of the columns `IDENTITY`. Raises `ValueError` if they are damaged."""
    task, method, agent, seed, budget, track = identity
    if not isinstance(seed, int):
        raise ValueError(f"a seed should be a number, got {seed!r:.80}")
    if track not in get_args(Track):
        raise ValueError(f"no track {track!r:.80}")
    of_task, of_method, of_agent = (parse_choice(str(part)) for part in (task, method, agent))
    return CellId(of_task, of_method, of_agent, seed, str(budget), cast(Track, str(track)))


def texts(cell: CellId) -> tuple[str | int, ...]:
    """The columns `IDENTITY` of a cell."""
    return tuple(cell.plain.values())


def values(result: Result, folder: Path, failures: int) -> dict[str, str | int | float | None]:
    """Column -> value of the row of a result that is recorded now, in a folder that has its files already."""
    measured, text = result.measurement, to_json(result)
    columns = numbers(measured) if measured else {}
    return {
        "key": result.key,
        **result.id.plain,
        "status": result.status,
        "reason": result.reason,
        **{name: columns.get(name) for name in _NUMBERS},
        "recorded_at": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "result": text,
        "checksum": checksum_of(text),
        "files": json.dumps(checksums_beside(folder, result) if measured else {}),
        "failures": failures,
        "again": 0,
    }


def result_of(text: Any, checksum: Any) -> Result:
    if checksum != checksum_of(text):
        raise ValueError("it does not have the checksum that was recorded with it")
    return from_json(text)


def checksum_of(text: Any) -> str:
    return hashlib.sha256(text if isinstance(text, bytes) else str(text).encode()).hexdigest()[:32]


def checksums_beside(folder: Path, result: Result) -> Mapping[str, str]:
    """Name -> SHA-256 (64 hex digits) of the traces and the policies that exist."""
    paths = cell_files(folder, result.id, result.key)
    named = {"traces": paths.traces, "policies": paths.policies}
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in named.items() if path.is_file()}
