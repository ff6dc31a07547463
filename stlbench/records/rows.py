"""A result as flat columns, for tables, logs and the gate; and a row of a ledger, with its checksums."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import fields
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, Self

from pydantic import TypeAdapter, ValidationError

from stlbench.records.fields import Name, Whole, first_problem
from stlbench.records.identity import IDENTITY, CellId, ReadCell
from stlbench.records.inputs import is_there, read
from stlbench.records.outputs import cell_files
from stlbench.records.result import Measurement, Result, Score, from_json, reported, to_json
from stlbench.records.status import Status

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
    key: Name
    status: Status
    failures: Whole  # how often in a row the cell has failed
    again: bool  # whether the next run measures the cell
    cell: ReadCell

    @classmethod
    def of(cls, number: int, key: object, status: object, failures: object, again: object, *identity: object) -> Self:
        """The row from a rowid and the columns `LISTED`. Raises `ValueError` if they are damaged."""
        named = dict(zip(IDENTITY, identity, strict=True))
        row: Self = _valid(cls, (number, key, status, failures, again, named))
        return row

    def is_of(self, result: Result) -> bool:
        """Whether the columns say what the result says."""
        return (self.key, self.status, self.cell) == (result.key, result.status, result.id)


def cell_of(*identity: object) -> CellId:
    """The cell of the columns `IDENTITY`. Raises `ValueError` if they are damaged."""
    cell: CellId = _valid(ReadCell, dict(zip(IDENTITY, identity, strict=True)))
    return cell


def _valid(kind: Any, value: object) -> Any:
    try:
        return _adapter(kind).validate_python(value)
    except ValidationError as error:
        raise ValueError(first_problem(error)) from error


@lru_cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


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
    there = {name: path for name, path in named.items() if is_there(path, folder)}
    return {name: hashlib.sha256(read(path, folder)).hexdigest() for name, path in there.items()}
