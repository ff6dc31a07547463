"""The column of time in a table of text, and the sampling time that it shows."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property

import numpy as np

from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.rollout.trace_table import TraceTable, number_of, split_unit

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
        texts = [row[self.place] for row in self.table.rows]
        first = Decimal(texts[0])  # floats would round stamps in nanoseconds
        seconds = np.array([float(Decimal(text) - first) for text in texts]) * self.unit
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
