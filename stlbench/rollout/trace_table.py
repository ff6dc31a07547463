"""A trace as a table of text (CSV)."""

from __future__ import annotations

import csv
import math
import re
import zlib
from collections import Counter
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property
from itertools import chain
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from stlbench.errors import UsageError, one_line
from stlbench.rollout.trace_text import STDIN, Lines
from stlbench.stl.predicates.samples import EXACT, NO_FLOAT

COLUMNS = 2**16
VALUES = 2**25  # each takes about 60 bytes as text; a row counts as one more
_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs"}
_DECLARED = re.compile(r"sep=(.)\s*", re.IGNORECASE)
"""The first line in which Excel says by what values are separated."""


@dataclass(frozen=True)
class TraceTable:
    """A trace as text: titles of columns, then one row per step. In messages the titles are row 1."""

    source: str
    titles: tuple[str, ...]
    rows: list[list[str]]
    delimiter: str  # in words, such as "commas"

    @cached_property
    def columns(self) -> dict[str, int]:
        """The place of each column by the name that a formula has for it; a column without a title is left out.

        A title with a unit or with other signs, `x [m/s]` or `/robot/x`, is the name `x` or `robot_x`, unless another
        column has it too.
        """
        plain = [title if title.isidentifier() else _plain(title) for title in self.titles]
        taken = Counter(plain)
        names = (name if taken[name] == 1 else title for name, title in zip(plain, self.titles, strict=True))
        return {name: place for place, name in enumerate(names) if name}

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.columns)

    def samples(self, used: Collection[str]) -> NDArray[np.float64]:
        """The columns `used` as numbers, (T + 1, k) with NaN in all others. Raises UsageError at what is none."""
        samples = np.full((len(self.rows), len(self.columns)), np.nan)
        for column, name in enumerate(self.columns):
            if name in used:
                samples[:, column] = self.column(name)
        return samples

    def column(self, name: str) -> list[float]:
        """One column as numbers. Raises `UsageError` where a value is no finite number, or no float keeps it."""
        place, values = self.columns[name], []
        for number, row in enumerate(self.rows, 2):
            value = number_of(row[place])
            if value is None or not abs(value) < EXACT:
                value = self.number(number, place)
                if _is_rounded(row[place], value):
                    raise UsageError(f"{self._at(number, place)}: {row[place]} {NO_FLOAT}")
            values.append(value)
        return values

    def number(self, number: int, place: int) -> float:
        """The value in a row and a column. Raises `UsageError` if it is no finite number."""
        text = self.rows[number - 2][place]
        value = number_of(text)
        if value is None or not math.isfinite(value):
            hint = "; write decimals with a point" if "," in text else ""
            raise UsageError(f"{self._at(number, place)}: '{text}' is no finite number{hint}")
        return value

    def _at(self, number: int, place: int) -> str:
        return f"{self.source}: row {number}, column {place + 1} ({self.titles[place]})"

    def without_end(self, names: Collection[str]) -> TraceTable:
        """Without the rows at its end in which all columns `names` are NaN or empty; the first row stays."""
        columns, count = [self.columns[name] for name in names], len(self.rows)
        while count > 1 and all(_is_missing(self.rows[count - 1][column]) for column in columns):
            count -= 1
        return replace(self, rows=self.rows[:count])


def read_table(path: Path) -> TraceTable:
    """Read a table of text from a file, or from standard input for `-`.

    Its header has most of commas, semicolons or tabs, which separate values, or the line before it says `sep=;`.
    Raises `UsageError` where there is no such file, no header, no row, or a row of another length, and as `Lines`.
    """
    source = "standard input" if path == STDIN else str(path)
    try:
        lines = Lines(path, source)
        header = next(lines, "")
        if declared := _DECLARED.fullmatch(header):
            header = next(lines, "")
        delimiter = declared[1] if declared else max(_DELIMITERS, key=header.count)
        table = csv.reader(chain([header], lines), delimiter=delimiter, skipinitialspace=True, strict=True)
        titles, *rows = [*_limited(table, lines, source)] or [[]]
    except (OSError, EOFError, zlib.error, UnicodeError, csv.Error) as error:
        raise UsageError(f"cannot read {source}: {error}") from error
    while rows and not rows[-1]:
        rows.pop()
    words = _DELIMITERS.get(delimiter, repr(delimiter))
    read = TraceTable(source, tuple(title.strip() for title in titles), rows, words)
    for problem in _problems(read):
        raise UsageError(f"{source}: {problem}")
    return read


def _limited(table: Iterator[list[str]], lines: Lines, source: str) -> Iterator[list[str]]:
    values = 0
    for row in table:
        lines.end_row()
        values += len(row) + 1
        if values == len(row) + 1 > COLUMNS + 1:
            raise UsageError(f"{source}: the header names {len(row):,} columns; at most {COLUMNS:,} are read")
        if values > VALUES:
            rule = f"at most {VALUES:,} are read; leave rows or columns out, or write an .npz"
            raise UsageError(f"{source} has too many values: {rule}")
        yield row


def _problems(table: TraceTable) -> Iterator[str]:
    titles, separated = table.titles, table.delimiter
    if not any(titles):
        yield "the file is empty; its first row must name the signals"
    if all(number_of(title) is not None for title in titles):
        yield f"the first row must name the signals, got the numbers {one_line(', '.join(titles))}"
    for title, count in Counter(filter(None, titles)).items():
        if count > 1:
            yield f"the header names '{title}' twice"
    hint = "" if separated == "commas" else f" (separated by {separated}, as the header is)"
    for number, row in enumerate(table.rows, 2):
        if len(row) != len(titles):
            yield f"row {number} has {len(row)} values, the header names {len(titles)} signals{hint}"
    if not table.rows:
        yield "there is no row below the header"


def split_unit(title: str) -> tuple[str, str | None]:
    """A title without the unit in brackets at its end, and the unit: `x [m/s]` is x, m/s."""
    for opening, closing in ("[]", "()"):
        if title.endswith(closing) and (begin := title.rfind(opening)) > 0:
            return title[:begin].rstrip(), title[begin + 1 : -1].strip()
    return title, None


def _plain(title: str) -> str:
    name = re.sub(r"\W+", "_", split_unit(title)[0]).strip("_")
    return name if name.isidentifier() else title


def _is_missing(text: str) -> bool:
    value = number_of(text) if text.strip() else math.nan
    return value is not None and math.isnan(value)


def number_of(text: str) -> float | None:
    try:
        return None if "_" in text else float(text)  # Python reads 1_000, CSV files do not mean it
    except ValueError:
        return None


def _is_rounded(text: str, value: float) -> bool:
    """Whether a text is a whole number that is not the float `value`."""
    digits = text.strip().lstrip("+-")
    return digits.isdecimal() and Decimal(digits) != Decimal(abs(value))
