"""What a study says while it runs: one line per finished cell on stderr, under them a bar where there is a terminal."""

from __future__ import annotations

import time
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console
from rich.text import Text

from stlbench.registry.choices import Choice
from stlbench.result import CellId, Result, reported

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

__all__ = ["Progress"]

_UNFIT = ("intractable", "unsuitable")
"""Found out at once and for every seed, so that such cells say nothing of how long others take."""


class Progress:
    """Counts the cells of one command (`study.run.Progress`); as a context manager it takes the bar away at the end."""

    def __init__(self) -> None:
        self.total = self.done = self.ran = 0
        self.missing = set[CellId]()
        self.console = Console(stderr=True, highlight=False, soft_wrap=True)
        self.bar: Bar | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self.bar is not None:
            self.bar.stop()

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        """Say how many cells there are, and begin to count the time."""
        total = done + len(missing)
        earlier = f", {done} of them done before" if done else ""
        self._say(f"{total} {'cell' if total == 1 else 'cells'}{earlier}")
        self.missing = set(missing)
        self._count(total, done)

    def _count(self, total: int, done: int) -> None:
        self.total, self.done, self.ran, self.since = total, done, 0, time.monotonic()
        if done < total:
            self.bar = _bar(self.console, total, done)
            self.bar.start()

    def note(self, text: str) -> None:
        """Say what the user should know."""
        self._say(text)

    def ended(self, result: Result) -> None:
        """Say how a cell ended, and how long the others may take."""
        self.done += 1
        self.missing.discard(result.id)
        if result.status in _UNFIT:
            self.missing -= {cell for cell in self.missing if _reward(cell) == _reward(result.id)}
        else:
            self.ran += 1
        self._say(f"[{self.done}/{self.total}] {describe(result)}")
        if self.bar is not None:
            self.bar.update(self.bar.task_ids[0], completed=self.done, description=self._left())

    def _left(self) -> str:
        """How long the rest may take, by the cells that ran; those of methods that do not fit their task take none."""
        if not (self.ran and self.missing):
            return ""
        return f"about {_duration((time.monotonic() - self.since) / self.ran * len(self.missing))} left"

    def _say(self, line: str) -> None:
        self.console.print(Text(line))


def _bar(console: Console, total: int, done: int) -> Bar:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    bar = Progress(*columns, console=console, disable=not console.is_terminal, refresh_per_second=2)
    bar.add_task("", total=total, completed=done)
    return bar


def _reward(cell: CellId) -> tuple[Choice, Choice]:
    """What decides whether the method fits."""
    return cell.task, cell.method


def describe(result: Result) -> str:
    """One line: name, status, and the two numbers that matter, or the reason."""
    name = result.id.name
    if result.measurement is None:
        return f"{name} {result.status}: {result.reason}" if result.reason else f"{name} {result.status}"
    score = reported(result.measurement.selected)
    return (
        f"{name} done: robustness {score.mean:.3f}, satisfied {100 * score.satisfaction:.1f} %, "
        f"{result.measurement.wall_seconds:.1f} s"
    )


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    return (
        f"{minutes // 60} h {minutes % 60} min"
        if minutes >= 60
        else f"{minutes} min {rest} s"
        if minutes
        else f"{rest} s"
    )
