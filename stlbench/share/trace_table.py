"""A trace as a table of text (CSV): its columns, that of time, and the sampling time that it shows. A stranger may
have made the file, so its size is limited.
"""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import math
import re
import sys
import zlib
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, replace
from decimal import Decimal, InvalidOperation
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import TextIO

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array
from stlbench.errors import UsageError, one_line
from stlbench.stl.predicates import EXACT, NO_FLOAT

STDIN = Path("-")
LARGEST = 2**29  # bytes of a file, and characters of its text
ROW = 2**24  # characters of a row, which may go over several lines
_HEAD = 2**12
_UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
_GZIP = b"\x1f\x8b"
_OTHERS = {
    b"{": "JSON",
    b"[": "JSON",
    b"MATLAB": "a MAT-file",
    b"\x89HDF": "HDF5, as MATLAB 7.3 writes it",
    b"PAR1": "Parquet",
    b"PK\x03\x04": "a zip file, such as a spreadsheet",
    b"\x93NUMPY": "one array of NumPy",
    b"\0": "no text: it has a byte 0",
}
"""How files begin that are no table of text -> what they are."""
_REMEDY = "write a table of text (CSV), as writetable of MATLAB and to_csv of pandas do, or an .npz"


class Lines(Iterator[str]):
    """The lines of a table of text: UTF-8 or, with its mark, UTF-16; also compressed by gzip.

    Raises, also on the way, `OSError`, `EOFError`, `zlib.error` or `UnicodeError` where it cannot be read, and
    `UsageError` where it is too large or has another format.
    """

    def __init__(self, path: Path, source: str) -> None:
        self._source = source
        self._file = self._opened(path)
        self._row = self._all = 0

    def __next__(self) -> str:
        line = self._file.readline(ROW + 1)
        self._row += len(line)
        self._all += len(line)
        if self._row > ROW:
            raise UsageError(f"{self._source}: a row has more than {ROW:,} characters; is a quotation mark missing?")
        if self._all > LARGEST:
            raise self._too_large()
        if not line:
            raise StopIteration
        return line

    def end_row(self) -> None:
        self._row = 0

    def _opened(self, path: Path) -> TextIO:
        with nullcontext(sys.stdin.buffer) if path == STDIN else path.open("rb") as file:
            data = file.read(LARGEST + 1)
        if len(data) > LARGEST:
            raise self._too_large()
        content: io.BytesIO | gzip.GzipFile = io.BytesIO(data)
        if data.startswith(_GZIP):
            content = gzip.GzipFile(fileobj=content)
        head = content.read(_HEAD)
        content.seek(0)
        encoding = "utf-16" if head.startswith(_UTF_16) else "utf-8-sig"
        begin = head.removeprefix(codecs.BOM_UTF8).lstrip()
        for mark, form in _OTHERS.items():
            if begin.startswith(mark) or (mark == b"\0" and mark in head and encoding != "utf-16"):
                raise UsageError(f"{self._source} is {form}; {_REMEDY}")
        return io.TextIOWrapper(content, encoding, newline="")

    def _too_large(self) -> UsageError:
        rule = f"at most {LARGEST >> 20} MiB of text are read; leave rows or columns out, or write an .npz"
        return UsageError(f"{self._source} is too large: {rule}")


COLUMNS = 2**16
VALUES = 2**25  # each takes about 60 bytes as text; a row counts as one more
_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs"}
_DECLARED = re.compile(r"sep=([^\r\n])\s*", re.IGNORECASE)
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

    def samples(self, used: Collection[str], gaps: bool = False) -> NDArray[np.float64]:
        """The columns `used` as numbers, (T + 1, k) with NaN in all others. `gaps` and errors as for `column`."""
        samples = np.full((len(self.rows), len(self.columns)), np.nan)
        for column, name in enumerate(self.columns):
            if name in used:
                samples[:, column] = self.column(name, gaps)
        return samples

    def column(self, name: str, gaps: bool = False) -> list[float]:
        """One column as numbers; with `gaps`, what is empty or NaN is NaN.

        Raises `UsageError` where another value is no finite number, or no float keeps it.
        """
        place, values = self.columns[name], []
        for number, row in enumerate(self.rows, 2):
            value = number_of(row[place])
            if value is None or not abs(value) < EXACT:
                value = math.nan if gaps and _is_missing(row[place]) else self.number(number, place)
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


#: how far a row's time may be from its place, in steps
_JITTER = 0.1
_NAME = re.compile(r"((?i:time|time_?stamp|stamp)|t)(?:_([a-z]+))?")
"""T is a temperature more often than a time."""
_SECONDS = {
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), 1.0),
    **dict.fromkeys(("ms", "msec", "milliseconds"), 1e-3),
    **dict.fromkeys(("us", "µs", "μs", "usec", "microseconds"), 1e-6),
    **dict.fromkeys(("ns", "nsec", "nanoseconds"), 1e-9),
    **dict.fromkeys(("min", "minutes"), 60.0),
    **dict.fromkeys(("h", "hours"), 3600.0),
}
"""Units that a title may name; without one it is in seconds."""


@dataclass(frozen=True)
class Times:
    """A column of time. Row numbers in messages are those of its table."""

    table: TraceTable
    place: int
    unit: float  # in seconds

    @property
    def title(self) -> str:
        return self.table.titles[self.place]

    @property
    def is_numeric(self) -> bool:
        return all(number_of(row[self.place]) is not None for row in self.table.rows)

    @cached_property
    def seconds(self) -> Array:
        """The times (T + 1,) in seconds after the first row. Raises `UsageError` where one is no finite number."""
        for number in range(2, len(self.table.rows) + 2):
            self.table.number(number, self.place)
        try:
            times = [Decimal(row[self.place]) for row in self.table.rows]  # floats would round stamps in nanoseconds
        except InvalidOperation as error:  # at an exponent that `float` takes
            what = f"the column '{self.title}' has a time with an exponent that is too large"
            raise UsageError(f"{self.table.source}: {what}") from error
        seconds = np.array([float(time - times[0]) for time in times]) * self.unit
        if not np.isfinite(seconds).all():
            raise UsageError(f"{self.table.source}: the times of the column '{self.title}' are too far apart")
        return seconds

    def check(self, dt: float) -> None:
        """Raises `UsageError` unless there is a row every `dt` seconds, to a tenth of it."""
        wrong = self._off(dt) > _JITTER * dt
        if wrong.any():
            i = int(wrong.argmax())
            due = float(self._text(0)) + i * dt / self.unit
            rule = f"{due:.15g} is expected with a sampling time of {dt:g} s; rows are one sampling time apart"
            raise UsageError(f"{self._said(i)}, {rule}")

    def check_rise(self) -> None:
        """Raises `UsageError` unless each time is greater than the one before it."""
        wrong = np.diff(self.seconds) <= 0
        if wrong.any():
            i = int(wrong.argmax()) + 1
            raise UsageError(f"{self._said(i)}, and the row before has {self._text(i - 1)}; time must rise")

    def sampling_time(self) -> float:
        """Seconds from row to row: the roundest number of them, or of rows a second, that the times agree with.

        Raises `UsageError` for fewer than two rows, or where they are not one distance apart, to a tenth of it.
        """
        mean = float(self.seconds[-1]) / (len(self.seconds) - 1)
        jitter = self._off(mean).max()
        if not jitter <= _JITTER * mean:
            steps = np.diff(self.seconds)
            usual = float(np.median(steps))
            i = int(np.abs(steps - usual).argmax()) + 1
            rule = f"{steps[i - 1]:g} s after the row before; rows must be one distance apart, and most are {usual:g} s"
            raise UsageError(f"{self._said(i)}, {rule}")
        return _roundest(mean, lambda dt: bool((self._off(dt) <= 2 * jitter + 1e-9 * mean).all()))

    def _off(self, dt: float) -> Array:
        """How far each row is from its place, in seconds."""
        return np.abs(self.seconds - np.arange(len(self.seconds)) * dt)

    def _text(self, i: int) -> str:
        return self.table.rows[i][self.place].strip()

    def _said(self, i: int) -> str:
        return f"{self.table.source}: row {i + 2} has {self.title} {self._text(i)}"


def times_of(table: TraceTable, signals: Collection[str] = ()) -> Times | None:
    """The first column of a table with times; None where there is none, or only one of the `signals`."""
    for name, place in table.columns.items():
        unit, match = split_unit(table.titles[place])[1], _NAME.fullmatch(name)
        if match and name not in signals and (seconds := _SECONDS.get((unit or match[2] or "s").lower())):
            return Times(table, place, seconds)
    return None


def _roundest(mean: float, agrees: Callable[[float], bool]) -> float:
    for digits in range(1, 17):
        for value in (float(f"{mean:.{digits}g}"), 1 / float(f"{1 / mean:.{digits}g}")):
            if agrees(value):
                return value
    return mean
