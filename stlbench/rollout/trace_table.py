"""A trace as a table of text (CSV)."""

from __future__ import annotations

import csv
import io
import math
import sys
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stlbench.errors import UsageError

STDIN = Path("-")
_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs"}
#: how far a row's time may be from its place, in steps
_JITTER = 0.1


@dataclass(frozen=True)
class TraceTable:
    """A trace as text: names of columns, then one row per step. In messages the names are row 1."""

    source: str
    names: tuple[str, ...]
    rows: list[list[str]]
    delimiter: str  # in words, such as "commas"

    def samples(self, used: Collection[str]) -> NDArray[np.float64]:
        """The columns `used` as numbers, (T + 1, k) with NaN in all others. Raises UsageError at what is none."""
        samples = np.full((len(self.rows), len(self.names)), np.nan)
        for column, name in enumerate(self.names):
            if name in used:
                samples[:, column] = self.column(name)
        return samples

    def column(self, name: str) -> list[float]:
        """One column as numbers. Raises `UsageError` where a value is no finite number."""
        column = self.names.index(name)
        values = []
        for number, row in enumerate(self.rows, 2):
            value = _number(row[column])
            if value is None or not math.isfinite(value):
                hint = "; write decimals with a point" if "," in row[column] else ""
                place = f"{self.source}: row {number}, column {column + 1} ({name})"
                raise UsageError(f"{place}: '{row[column]}' is no finite number{hint}")
            values.append(value)
        return values

    def without_end(self, names: Collection[str]) -> TraceTable:
        """Without the rows at its end in which all columns `names` are NaN or empty; the first row stays."""
        columns, count = [self.names.index(name) for name in names], len(self.rows)
        while count > 1 and all(_is_missing(self.rows[count - 1][column]) for column in columns):
            count -= 1
        return replace(self, rows=self.rows[:count])

    def is_numeric(self, name: str) -> bool:
        column = self.names.index(name)
        return all(_number(row[column]) is not None for row in self.rows)

    def check_times(self, dt: float) -> None:
        """Raises `UsageError` unless the column `time`, in seconds, has a row every `dt`, to a tenth of it."""
        times = self.column("time")
        for i, time in enumerate(times):
            due = times[0] + i * dt
            if abs(time - due) > _JITTER * dt:
                rule = f"{due:g} is expected with a sampling time of {dt:g} s; rows are one sampling time apart"
                raise UsageError(f"{self.source}: row {i + 2} has time {time:g}, {rule}")


def read_table(path: Path) -> TraceTable:
    """Read a table of text from a file, or from standard input for `-`.

    Its header has most of commas, semicolons or tabs, which separate values. Raises `UsageError` where there is no such
    file, no header, no row, or a row of another length.
    """
    source = "standard input" if path == STDIN else str(path)
    try:
        text = (sys.stdin.buffer.read() if path == STDIN else path.read_bytes()).decode("utf-8-sig")
        header, _, _ = text.partition("\n")
        delimiter = max(_DELIMITERS, key=header.count)
        lines = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, skipinitialspace=True, strict=True)
        first, *rows = [*lines] or [[]]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"cannot read {source}: {error}") from error
    while rows and not rows[-1]:
        rows.pop()
    table = TraceTable(source, tuple(name.strip() for name in first), rows, _DELIMITERS[delimiter])
    for problem in _problems(table):
        raise UsageError(f"{source}: {problem}")
    return table


def _problems(table: TraceTable) -> Iterator[str]:
    names, separated = table.names, table.delimiter
    if not any(names):
        yield "the file is empty; its first row must name the signals"
    if all(_number(name) is not None for name in names):
        yield f"the first row must name the signals, got the numbers {', '.join(names)}"
    for column, name in enumerate(names, 1):
        if not name:
            yield f"column {column} has no name in the header"
        if name in names[: column - 1]:
            yield f"the header names '{name}' twice"
    hint = "" if separated == "commas" else f" (separated by {separated}, as the header is)"
    for number, row in enumerate(table.rows, 2):
        if len(row) != len(names):
            yield f"row {number} has {len(row)} values, the header names {len(names)} signals{hint}"
    if not table.rows:
        yield "there is no row below the header"


def _is_missing(text: str) -> bool:
    value = _number(text) if text.strip() else math.nan
    return value is not None and math.isnan(value)


def _number(text: str) -> float | None:
    try:
        return None if "_" in text else float(text)  # Python reads 1_000, CSV files do not mean it
    except ValueError:
        return None
