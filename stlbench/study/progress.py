"""How far a run is. The run itself says it, and `stlbench watch` from outside."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Self

from rich.console import Console, RenderableType
from rich.text import Text

from stlbench.records.identity import CellId, Setting
from stlbench.records.result import Result, reported
from stlbench.records.status import ACCIDENTS
from stlbench.study.live_cells import Running, draws, duration, line_of, running

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

_MINUTE = 60.0
_LISTED = 8  # running cells that are listed, at most
_SOON = 0.5  # seconds; a shorter rest is not said: the last cell takes longer than was expected


class Tally:
    """Counts the cells of a run, and estimates the time that is left.

    A cell is expected to take the mean of the cells that differ from it in the seed alone. Before one of these has
    ended, it is the mean of all. `done` cells have a result from before, of which no more is known.
    """

    def __init__(self, missing: Iterable[CellId], done: int = 0) -> None:
        self._missing = Counter(cell.setting for cell in missing)
        self._ended = Counter({"done before": done} if done else {})
        self._times = dict[Setting, list[float]]()
        self._unfit = set[Setting]()
        """The other seeds of these end at once as well."""

    def add(self, result: Result) -> None:
        self._ended[result.status] += 1
        if result.measurement is not None:
            self._times.setdefault(result.id.setting, []).append(result.measurement.wall_seconds)
        elif result.status in ("intractable", "unsuitable"):
            self._unfit.add(result.id.setting)

    def remove(self, cell: CellId) -> None:
        self._missing[cell.setting] -= 1

    def left(self, cells: Sequence[Running], now: float) -> str:
        """The time until the last cell ends: "about 3 min 5 s left"; empty where nothing is left or known."""
        seconds = self._seconds(cells, now)
        return f"about {duration(seconds)} left" if seconds >= _SOON else ""

    def expected(self) -> float:
        """Seconds that all cells take which are missing, one after the other; 0 where nothing is known."""
        return self._seconds((), time.time())

    def _seconds(self, cells: Sequence[Running], now: float) -> float:
        times = {setting: list(seconds) for setting, seconds in self._times.items()}
        for one in cells:
            if one.share > 0 and one.id.setting not in self._times:  # what its checkpoints say of the whole
                times.setdefault(one.id.setting, []).append((one.told - one.began) / one.share)
        if not times:
            return 0.0
        mean = sum(map(sum, times.values())) / sum(map(len, times.values()))
        means = {setting: sum(seconds) / len(seconds) for setting, seconds in times.items()}
        waiting = self._missing - Counter(one.id.setting for one in cells)
        rest = [max(0.0, means.get(one.id.setting, mean) - (now - one.began)) for one in cells]
        work = sum(count * means.get(setting, mean) for setting, count in waiting.items() if setting not in self._unfit)
        work += sum(rest)
        return max([work / max(1, len(cells)), *rest])

    def lines(self, cells: Sequence[Running] | None, now: float, *, drawn: bool = False) -> list[str]:
        """The counts, "2 of 3 cells, 1 done, 1 raised, 1 running, about 12 s left", and a line for each cell that runs.

        Args:
            cells: that run; None where nobody writes in the folder.
            now: seconds since 1970.
            drawn: whether curves are drawn.
        """
        ended = self._ended.total()
        counts = [f"{ended} of {ended + self._missing.total()} cells"]
        counts += [f"{count} {status}" for status, count in self._ended.items()]
        if cells is None:
            return [", ".join([*counts, "nobody writes here"])]
        left = self.left(cells, now)
        first = ", ".join([*counts, f"{len(cells)} running", *([left] if left else [])])
        more = [f"and {len(cells) - _LISTED} more"] if len(cells) > _LISTED else []
        return [first, *(line_of(one, now, drawn=drawn) for one in cells[:_LISTED]), *more]


class Progress:
    """Prints how a run goes on (`study.run.Progress`), on stderr.

    A terminal has a bar, the running cells of the folder below it, and a line for each cell that failed. Elsewhere,
    and to be verbose, there is a line for each cell that ends; elsewhere one a minute has the running cells too.
    """

    def __init__(self, folder: Path | None = None, verbose: bool = False) -> None:
        self.total = self.done = 0
        self.tally = Tally(())
        self.folder = folder
        self.over = threading.Event()
        self.console = Console(stderr=True, highlight=False, soft_wrap=True)
        self.lists = verbose or not self.console.is_terminal
        self.bar: Bar | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self.over.set()
        if self.bar is not None:
            self.bar.stop()

    def begin(self, missing: Sequence[CellId], done: int) -> None:
        total = done + len(missing)
        earlier = f", {done} of them done before" if done else ""
        self.note(f"{total} {'cell' if total == 1 else 'cells'}{earlier}")
        self.tally = Tally(missing, done)
        self.start(total, done)

    def start(self, total: int, done: int) -> None:
        self.total, self.done = total, done
        if done < total:
            self.bar = _bar(self.console, total, done, self._below)
            self.bar.start()
            if not self.console.is_terminal:
                threading.Thread(target=self._each_minute, daemon=True).start()

    def note(self, text: str) -> None:
        self.console.print(Text(text))

    def ended(self, result: Result) -> None:
        self.done += 1
        self.tally.remove(result.id)
        self.tally.add(result)
        if self.lists or result.status in ACCIDENTS:
            self.note(f"[{self.done}/{self.total}] {describe(result)}")
        if self.bar is not None:
            self.bar.update(self.bar.task_ids[0], completed=self.done, description=self._left())

    def _running(self) -> list[Running]:
        return [] if self.folder is None else running(self.folder)

    def _left(self) -> str:
        return self.tally.left(self._running(), time.time())

    def _below(self) -> list[str]:
        """The cells that run; the time in the bar goes on too."""
        if self.bar is not None and self.bar.tasks:
            self.bar.tasks[0].description = self._left()
        return self.tally.lines(self._running(), time.time(), drawn=draws(self.console))[1:]

    def _each_minute(self) -> None:
        while not self.over.wait(_MINUTE):
            self.note("; ".join(self.tally.lines(self._running(), time.time())))


def _bar(console: Console, total: int, done: int, below: Callable[[], list[str]]) -> Bar:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    class WithCells(Progress):
        def get_renderables(self) -> Iterable[RenderableType]:
            yield from super().get_renderables()
            yield from (Text(f"  {line}", overflow="ellipsis", no_wrap=True) for line in below())

    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    bar = WithCells(*columns, console=console, disable=not console.is_terminal, refresh_per_second=1)
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
