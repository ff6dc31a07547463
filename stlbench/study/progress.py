"""What a study says while it runs: one line per finished cell on stderr.

Where there is a terminal, a bar is under them, with the cells that run; elsewhere a line a minute tells of these.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console, RenderableType
from rich.text import Text

from stlbench.records.identity import CellId
from stlbench.records.result import Result, reported
from stlbench.records.status import ACCIDENTS
from stlbench.registry.choices import Choice
from stlbench.study.live_cells import MOST, Sight, draws, line_of
from stlbench.study.pace import LATEST, Ended, Pace, reward_of, unfit

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

_MINUTE = 60.0
_SHARE = 0.02
"""Of its time, a run spends so much at most on saying how long the rest takes."""


class Progress:
    """Counts the cells of one command (`study.run.Progress`); as a context manager it takes the bar away at the end.

    Args:
        folder: of results, where cells that run say how far they are; they are not shown where it is left out.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.total = self.done = self.failed = 0
        self.missing = dict[CellId, None]()  # a set that keeps the order
        self.unfit = set[tuple[Choice, Choice]]()
        self.latest = deque[Ended](maxlen=LATEST)
        self.jobs = 0
        self.sight = Sight(folder)
        self.said, self.due = "", 0.0
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
        self.total, self.done = total, done
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
        self._learn(result)
        self.failed += result.status in ACCIDENTS
        self._say(f"[{self.done}/{self.total}] {describe(result)}")
        if self.bar is not None:
            self.bar.update(self.bar.task_ids[0], completed=self.done, description=self._left())

    def _learn(self, result: Result) -> None:
        """What a result says of how long the others take."""
        for never in unfit([result]) - self.unfit:
            self.missing = {cell: None for cell in self.missing if reward_of(cell) != never}
            self.unfit.add(never)
        if result.measurement is not None:
            self.latest.append(Ended(result.id, result.measurement.wall_seconds, time.time()))
            said = result.provenance.get("jobs", "")
            self.jobs = int(said) if said.isdecimal() else 0

    def _left(self) -> str:
        """How long the rest may take; said again as it was where it was asked too soon."""
        began = time.monotonic()
        if began >= self.due:
            self.said = Pace(time.time(), self.missing, self.sight.look(), self.latest, self.jobs).words
            self.due = began + (time.monotonic() - began) / _SHARE
        return self.said

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
