"""How far a run is, as the run itself says it."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any, Self

from rich.console import Console
from rich.text import Text

from stlbench.errors import counted
from stlbench.records.identity import CellId, Setting
from stlbench.records.result import ACCIDENTS, Result

if TYPE_CHECKING:
    from rich.progress import Progress as Bar

_MINUTE = 60.0
_SOON = 0.5  # seconds; a shorter rest is not said: the last cell takes longer than was expected


class Tally:
    """Counts the cells of a run, and estimates the time that is left.

    A cell is expected to take the mean of the cells that differ from it in the seed alone. Before one of these has
    ended, it is the mean of all. `done` cells have a result from before, of which no more is known. How many run at a
    time is what the cells that have ended took together, for each second of the run.
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

    def left(self, elapsed: float) -> str:
        """The time until the last cell ends, `elapsed` seconds after the first began: "about 3 min 5 s left".

        Empty where nothing is left or known.
        """
        taken = sum(map(sum, self._times.values()))
        seconds = self.expected() / max(1.0, taken / elapsed) if elapsed > 0 else 0.0
        return f"about {duration(seconds)} left" if seconds >= _SOON else ""

    def expected(self) -> float:
        """Seconds that all cells take which are missing, one after the other; 0 where nothing is known."""
        if not self._times:
            return 0.0
        mean = sum(map(sum, self._times.values())) / sum(map(len, self._times.values()))
        means = {setting: sum(seconds) / len(seconds) for setting, seconds in self._times.items()}
        waiting = (+self._missing).items()
        return sum(count * means.get(setting, mean) for setting, count in waiting if setting not in self._unfit)

    def line(self, elapsed: float) -> str:
        """The counts: "2 of 3 cells, 1 done, 1 raised, about 12 s left"."""
        ended, left = self._ended.total(), self.left(elapsed)
        counts = [f"{ended} of {ended + self._missing.total()} cells"]
        counts += [f"{count} {status}" for status, count in self._ended.items()]
        return ", ".join([*counts, *([left] if left else [])])


class Progress:
    """Prints how a run goes on (`study.logs.Listener`), on stderr.

    A terminal has a bar, and a line for each cell that failed. Elsewhere, and to be verbose, there is a line for each
    cell that ends; elsewhere one a minute counts them.
    """

    def __init__(self, verbose: bool = False) -> None:
        self.total = self.done = 0
        self.tally = Tally(())
        self.begun = time.monotonic()
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
        self.note(f"{counted(total, 'cell')}{earlier}")
        self.tally = Tally(missing, done)
        self.start(total, done)

    def start(self, total: int, done: int) -> None:
        self.total, self.done, self.begun = total, done, time.monotonic()
        if done < total:
            self.bar = bar_on(self.console, refresh_per_second=1)
            self.bar.add_task("", total=total, completed=done)
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

    def _left(self) -> str:
        return self.tally.left(time.monotonic() - self.begun)

    def _each_minute(self) -> None:
        while not self.over.wait(_MINUTE):
            self.note(self.tally.line(time.monotonic() - self.begun))


def bar_on(console: Console, **settings: Any) -> Bar:
    """A bar with its counts, its time and a text, where the console is a terminal; further `settings` of rich's."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    return Progress(*columns, console=console, disable=not console.is_terminal, **settings)


def duration(seconds: float) -> str:
    """ "12 s", "3 min 5 s", "2 h 10 min"."""
    minutes, rest = divmod(round(seconds), 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"


def describe(result: Result) -> str:
    """One line: name, status, and the two numbers that matter, or the reason."""
    name = result.id.name
    if result.measurement is None:
        return f"{name} {result.how}"
    score = result.measurement.score
    return (
        f"{name} done: robustness {score.mean:.3f}, satisfied {100 * score.satisfaction:.1f} %, "
        f"{result.measurement.wall_seconds:.1f} s"
    )
