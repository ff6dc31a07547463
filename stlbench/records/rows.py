"""The rows of a ledger as Python values, with checksums; and the warning about a damaged one."""

import hashlib
import json
import math
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, Self

from stlbench.records.identity import IDENTITY, CellId, Name, ReadCell, Whole, valid
from stlbench.records.result import SCHEMA, Result, Status, from_json, to_json
from stlbench.records.result_files import cell_files, is_there, read


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
        row: Self = valid(cls, (number, key, status, failures, again, named))
        return row

    def is_of(self, result: Result) -> bool:
        """Whether the columns say what the result says."""
        return (self.key, self.status, self.cell) == (result.key, result.status, result.id)


def cell_of(*identity: object) -> CellId:
    """The cell of the columns `IDENTITY`. Raises `ValueError` if they are damaged."""
    cell: CellId = valid(ReadCell, dict(zip(IDENTITY, identity, strict=True)))
    return cell


def texts(cell: CellId) -> tuple[str | int, ...]:
    """The columns `IDENTITY` of a cell."""
    return tuple(cell.plain.values())


def values(result: Result, folder: Path, failures: int, *, again: bool = False) -> dict[str, str | int | float | None]:
    """Column -> value of the row of a result that is recorded now, in a folder that has its files already."""
    text = to_json(result)
    return {
        **_columns(result),
        "recorded_at": datetime.now(UTC).isoformat(timespec="milliseconds"),
        "result": text,
        "checksum": checksum_of(text),
        "files": json.dumps(checksums_beside(folder, result) if result.measurement else {}),
        "failures": failures,
        "again": int(again),
    }


def _columns(result: Result) -> dict[str, str | int | float | None]:
    """The columns that repeat parts of the result, for SQL."""
    measured = result.measurement
    return {
        "key": result.key,
        **result.id.plain,
        "status": result.status,
        "reason": result.reason,
        **{name: None if measured is None else datum.of(measured) for name, datum in SCHEMA.items() if datum.ledger},
    }


def agree(columns: Mapping[str, Any], result: Result) -> bool:
    """Whether the columns of a row say what its result says.

    A number may be NULL: its column is newer than the row, or it is NaN. Another machine may round a mean otherwise.
    """

    def is_same(stored: Any, told: str | int | float | None) -> bool:
        if isinstance(told, float) and (stored is None or isinstance(stored, float)):
            return stored is None or math.isclose(stored, told, rel_tol=1e-9, abs_tol=1e-9)
        return bool(stored == told)

    return all(is_same(columns.get(name), told) for name, told in _columns(result).items())


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


OTHER = "its columns do not say what its result says"


class LedgerWarning(UserWarning):
    """A part of a ledger is damaged; the others can be read."""


class Inspected(NamedTuple):
    """One row, with its result or its damage."""

    key: str
    cell: CellId | None  # None if it cannot be read
    files: Mapping[str, str]  # checksums of the cell's files
    result: Result | str  # a text says what is wrong with the row
    again: bool = False  # whether the next run measures the cell
    own_key: str = ""  # the key of its result, if its columns are damaged
