"""A recorded trace as a CSV file: a header row that names the signals, one row a step."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.errors import UsageError

__all__ = ["Trace", "read_trace"]


class Trace(NamedTuple):
    """Samples (T + 1, k) of k named signals."""

    names: tuple[str, ...]
    samples: NDArray[np.float64]


def read_trace(path: Path) -> Trace:
    """Read a trace. Rows and columns are counted from 1 in messages, and the header is row 1.

    Raises:
        UsageError: no such file, no header, or a row that is too short, too long or not made of finite numbers.
    """
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            return _parsed(csv.reader(file, skipinitialspace=True, strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"cannot read {path}: {error}") from error
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None


def _parsed(lines: Iterable[list[str]]) -> Trace:
    rows = enumerate(lines, 1)
    _, header = next(rows, (1, []))
    names = _names(header)
    samples = [_sample(entry, number, names) for number, entry in _without_blank_end(rows)]
    if not samples:
        raise UsageError("there is no row below the header")
    return Trace(names, np.array(samples))


def _names(header: list[str]) -> tuple[str, ...]:
    names = tuple(name.strip() for name in header)
    if not any(names):
        raise UsageError("the file is empty; its first row must name the signals")
    if all(_number(name) is not None for name in names):
        raise UsageError(f"the first row must name the signals, got the numbers {', '.join(names)}")
    for column, name in enumerate(names, 1):
        if not name:
            raise UsageError(f"column {column} has no name in the header")
        if name in names[: column - 1]:
            raise UsageError(f"the header names '{name}' twice")
    return names


def _without_blank_end(rows: Iterable[tuple[int, list[str]]]) -> Iterator[tuple[int, list[str]]]:
    """All rows but empty lines at the end of the file."""
    blank: list[tuple[int, list[str]]] = []
    for number, entry in rows:
        if entry:
            yield from blank
            blank.clear()
            yield number, entry
        else:
            blank.append((number, entry))


def _sample(entry: list[str], number: int, names: tuple[str, ...]) -> list[float]:
    if len(entry) != len(names):
        raise UsageError(f"row {number} has {len(entry)} values, the header names {len(names)} signals")
    sample = []
    for column, (text, name) in enumerate(zip(entry, names, strict=True), 1):
        value = _number(text)
        if value is None or not math.isfinite(value):
            raise UsageError(f"row {number}, column {column} ({name}): '{text}' is no finite number")
        sample.append(value)
    return sample


def _number(text: str) -> float | None:
    try:
        return None if "_" in text else float(text)  # Python reads 1_000, CSV files do not mean it
    except ValueError:
        return None
