"""What a study says while it runs: one line per finished cell on stderr.

Where there is a terminal, a bar is under them, with the cells that run; elsewhere a line a minute tells of these.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console, RenderableType
from rich.text import Text

from stlbench.cli.live import MOST, Sight, begun_of, draws, line_of, remaining
from stlbench.registry.choices import Choice
from stlbench.result import ACCIDENTS, CellId, Result, reported
from stlbench.study.outlook import Took

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

__all__ = ["Progress"]

_MINUTE = 60.0
_UNFIT = ("intractable", "unsuitable")
"""Found out at once and for every seed, so that such cells say nothing of how long others take."""


class Progress:
    """Counts the cells of one command (`study.run.Progress`); as a context manager it takes the bar away at the end.

    Args:
        folder: of results, where cells that run say how far they are; they are not shown where it is left out.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.total = self.done = self.failed = 0
        self.missing = dict[CellId, None]()  # a set that keeps the order
        self.took = list[Took]()
        self.sight = Sight(folder)
        self.began: float | None = None
        self.over = threading.Event()
        self.console = Console(stderr=True, highlight=False, soft_wrap=True)
        self.bar: Bar | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.over.set()
        if self.bar is not None:
            self.bar.stop()

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        """Say how many cells there are, and begin to count the time."""
        total = done + len(missing)
        earlier = f", {done} of them done before" if done else ""
        self._say(f"{total} {'cell' if total == 1 else 'cells'}{earlier}")
        self.missing = dict.fromkeys(missing)
        self._count(total, done)

    def _count(self, total: int, done: int) -> None:
        self.total, self.done, self.since = total, done, time.monotonic()
        if done < total:
            self.bar = _bar(self.console, total, done, self._below)
            self.bar.start()
            if not self.console.is_terminal:
                threading.Thread(target=self._tell, daemon=True).start()

    def note(self, text: str) -> None:
        """Say what the user should know."""
        self._say(text)

    def ended(self, result: Result) -> None:
        """Say how a cell ended, and how long the others may take."""
        self.done += 1
        self.missing.pop(result.id, None)
        if result.status in _UNFIT:
            self.missing = {cell: None for cell in self.missing if _reward(cell) != _reward(result.id)}
        elif result.measurement is not None:
            self.took.append(Took(result.id, result.measurement.wall_seconds))
        self.failed += result.status in ACCIDENTS
        self._say(f"[{self.done}/{self.total}] {describe(result)}")
        if self.bar is not None:
            self.bar.update(self.bar.task_ids[0], completed=self.done, description=self._left())

    def _left(self) -> str:
        """How long the rest may take; cells of methods that do not fit their task take no time.

        Cells do not count what it takes to start them, nor that others slow them down before they begin: their times
        are stretched so that they fill the time that has passed.
        """
        cells, now = self.sight.look(), time.time()
        begun = [one for one in begun_of(cells, now) if one.cell in self.missing]
        if cells and self.began is None:
            self.began = cells[0].began
            self.since = time.monotonic() - (now - self.began)
        waiting = [cell for cell in self.missing if all(cell != one.cell for one in begun)]
        busy = sum(each.seconds for each in self.took) + sum(each.seconds for each in begun)
        passed = (time.monotonic() - self.since) * self.sight.jobs
        return remaining(waiting, begun, self.took, self.sight.jobs, passed / busy if self.took and busy else 1.0)

    def _below(self) -> list[str]:
        """Under the bar: the cells that run. The time in the bar goes on too."""
        if self.bar is not None and self.bar.tasks:
            self.bar.tasks[0].description = self._left()
        cells, now = self.sight.look(), time.time()
        more = [f"and {len(cells) - MOST} more"] if len(cells) > MOST else []
        return [*(line_of(one, now, drawn=draws(self.console)) for one in cells[:MOST]), *more]

    def _tell(self) -> None:
        """Where nobody sees a bar: a line a minute."""
        while not self.over.wait(_MINUTE):
            left, below = self._left(), self._below()
            said = [f"{self.done} of {self.total} done", *([f"{self.failed} failed"] if self.failed else [])]
            self._say("; ".join([*said, *([left] if left else []), *(f"running {line}" for line in below)]))

    def _say(self, line: str) -> None:
        self.console.print(Text(line))


def _bar(console: Console, total: int, done: int, below: Callable[[], list[str]]) -> Bar:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    class WithCells(Progress):
        def get_renderables(self) -> Iterable[RenderableType]:
            yield from super().get_renderables()
            yield from (Text(f"  {line}", overflow="ellipsis", no_wrap=True) for line in below())

    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    bar = WithCells(*columns, console=console, disable=not console.is_terminal, refresh_per_second=2)
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
