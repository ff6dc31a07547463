"""From results to rows of a ledger and back, with checksums that tell a row that was damaged."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from datetime import UTC, datetime
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, Self, cast, get_args

from stlbench.records.cell_files import cell_files
from stlbench.records.identity import IDENTITY, CellId, Track
from stlbench.records.result import Result, from_json, numbers, to_json
from stlbench.records.status import Status
from stlbench.registry.choices import parse_choice

LISTED = f"key, status, failures, again, {', '.join(IDENTITY)}"
"""The columns of a `Row`."""

_NUMBERS = ("robustness_mean", "satisfaction", "training_cpu_seconds", "training_wall_seconds")
"""Columns for queries by SQL."""


class Row(NamedTuple):
    """A row without its result."""

    number: int
    """Rows that were recorded later have greater numbers."""
    key: str
    status: Status
    failures: int
    """How often in a row the cell has failed."""
    again: bool
    """Whether the next run measures the cell."""
    cell: CellId

    @classmethod
    def of(cls, number: int, key: str, status: Status, failures: int, again: int, *identity: str | int) -> Self:
        """From a rowid and the columns `LISTED`. Raises `ValueError` if they are damaged."""
        if status not in get_args(Status):
            raise ValueError(f"no status {status!r:.80}")
        return cls(number, key, status, failures, bool(again), cell_of(*identity))


_choice = lru_cache(maxsize=4096)(parse_choice)


def cell_of(*identity: str | int) -> CellId:
    """The cell of the columns `IDENTITY`. Raises `ValueError` if they are damaged."""
    task, method, agent, seed, budget, track = identity
    if not isinstance(seed, int):
        raise ValueError(f"a seed should be a number, got {seed!r:.80}")
    if track not in get_args(Track):
        raise ValueError(f"no track {track!r:.80}")
    return CellId(
        _choice(str(task)), _choice(str(method)), _choice(str(agent)), seed, str(budget), cast(Track, str(track))
    )


def texts(cell: CellId) -> tuple[str, str, str, int, str, str]:
    """The columns `IDENTITY` of a cell."""
    return str(cell.task), str(cell.method), str(cell.agent), cell.seed, cell.budget, cell.track


def values(result: Result, folder: Path, failures: int) -> dict[str, str | int | float | None]:
    """Column -> value of the row of a result that is recorded now, in a folder that has its files already."""
    measured, text = result.measurement, to_json(result)
    columns = numbers(measured) if measured else {}
    return {
        "key": result.key,
        **dict(zip(IDENTITY, texts(result.id), strict=True)),
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
    """The result in a row. Raises `ValueError` if it is damaged."""
    if checksum != checksum_of(text):
        raise ValueError("it does not have the checksum that was recorded with it")
    return from_json(text)


def checksum_of(text: Any) -> str:
    """The checksum of a text: 32 hex digits."""
    return hashlib.sha256(text if isinstance(text, bytes) else str(text).encode()).hexdigest()[:32]


def checksums_beside(folder: Path, result: Result) -> Mapping[str, str]:
    """Name -> SHA-256 (64 hex digits) of the traces and the policies that exist."""
    paths = cell_files(folder, result.id, result.key)
    named = {"traces": paths.traces, "policies": paths.policies}
    return {name: _sha256(path) for name, path in named.items() if path.is_file()}


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
