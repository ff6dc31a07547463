"""What runs just now: each cell says in a file of the folder of results how far it is, for whoever looks."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import TypeAdapter

from stlbench.errors import UsageError
from stlbench.records.fields import Finite, Name, Share, Whole
from stlbench.records.identity import CellId
from stlbench.records.inputs import names, read
from stlbench.records.outputs import inside, write

if TYPE_CHECKING:
    from rich.console import Console

FOLDER = "running"  # name of the folder, in a folder of results. It has a file for each cell that runs.
Glance = Callable[[], tuple[float, float]]
"""Scores a checkpoint from a few starts: the share that satisfies, in [0, 1], and the mean robustness."""
_SHARE = 0.02  # of a cell's time, for scores that only someone who watches needs
_SECONDS = 0.2  # least time between two writings
_POINTS = 200  # of a curve, at most; budgets have ten to twenty checkpoints
_BARS = 20


@dataclass(frozen=True)
class Running:
    name: Name
    budget: Name
    of: Whole  # environment steps of its training
    began: Finite  # when, in seconds since 1970
    steps: Whole = 0  # environment steps at its last checkpoint
    told: Finite = 0.0  # time of the last checkpoint; at first when it began
    satisfaction: Share | None = None  # from a few starts, at the last scored checkpoint; None before one
    robustness: float | None = None
    curve: tuple[tuple[Whole, Share, float], ...] = ()
    """Of the checkpoints that were scored, the latest: steps, share that satisfies, mean robustness."""

    @property
    def id(self) -> CellId:
        return CellId.parse(self.name, self.budget)

    @property
    def share(self) -> float:
        """Of the training that is done, in [0, 1]."""
        return min(1.0, self.steps / self.of) if self.of else 0.0


class Notice:
    """Reports how far one cell is; does nothing without a file, and passes over errors of writing."""

    def __init__(self, path: Path | None, now: Running) -> None:
        self._path, self._now, self._spent, self._written = path, now, 0.0, 0.0

    def begin(self) -> None:
        self._write()

    def at(self, steps: int, glance: Glance | None = None) -> None:
        """Report a checkpoint; it is scored if that takes little of the cell's time."""
        if self._path is None or time.time() - self._written < _SECONDS:
            return
        self._now = replace(self._now, steps=steps, told=time.time())
        if glance is not None and self._spent <= _SHARE * (time.time() - self._now.began):
            self._score(glance)
        self._write()

    def _score(self, glance: Glance) -> None:
        began = time.time()
        with suppress(Exception):  # whatever is wrong with a policy is said where it counts, by the referee
            satisfaction, robustness = glance()
            curve = (*self._now.curve, (self._now.steps, satisfaction, robustness))[-_POINTS:]
            self._now = replace(self._now, satisfaction=satisfaction, robustness=robustness, curve=curve)
        self._spent += time.time() - began

    def _write(self) -> None:
        if self._path is not None:
            self._written = time.time()
            with suppress(OSError, ValueError):
                write(self._path, json.dumps(asdict(self._now)), self._path.parents[1])


def announce(folder: Path | None, cell: CellId, steps: int) -> Notice:
    """List the cell among those that run in the folder, until it has `ended`; nowhere without a folder."""
    now = time.time()
    path = None if folder is None else _file(folder, cell)
    notice = Notice(path, Running(cell.name, cell.budget, steps, now, told=now))
    notice.begin()
    return notice


def _file(folder: Path, cell: CellId) -> Path:
    return folder / FOLDER / f"{cell.name}_{cell.budget}.json".replace("/", "_")


def ended(folder: Path, cell: CellId) -> None:
    """Take the cell off the list. This follows the record of its result, so that it is never in neither place."""
    with suppress(OSError, UsageError):
        inside(_file(folder, cell), folder).unlink(missing_ok=True)


def clear(folder: Path) -> None:
    """Nothing runs in the folder: files of cells whose machine went off are taken away.

    Raises `UsageError` where the folder of these files is a link.
    """
    for path in inside(folder / FOLDER, folder).glob("*"):
        with suppress(OSError):
            path.unlink()
    with suppress(OSError):
        (folder / FOLDER).rmdir()


def running(folder: Path) -> list[Running]:
    """The cells that run, in the order in which they began. Damaged files are passed over."""
    cells = list[Running]()
    for name in names(folder / FOLDER, folder, ".json"):
        with suppress(OSError, ValueError):
            one = _adapter().validate_json(read(folder / FOLDER / name, folder))
            if one.id:
                cells.append(replace(one, curve=one.curve[-_POINTS:]))
    return sorted(cells, key=lambda one: (one.began, one.name))


@cache
def _adapter() -> TypeAdapter[Running]:
    return TypeAdapter(Running)


def line_of(one: Running, now: float, *, drawn: bool = False) -> str:
    """hold-disc/funnel/dqn/3: 42 %, 16,800 of 40,000 steps, 12 s; satisfied 88 %, robustness 0.310.

    Where it is `drawn`, for a terminal, with the robustness of the checkpoints so far: ▁▃▅▇.
    """
    score = "" if one.satisfaction is None or one.robustness is None else _score(one.satisfaction, one.robustness)
    done = f"{100 * one.share:.0f} %, {one.steps:,} of {one.of:,} steps" if one.share < 1 else "trained, is scored"
    curve = f" {sparkline([mean for _, _, mean in one.curve])}" if drawn and one.curve else ""
    return f"{one.name}: {done}, {duration(max(0.0, now - one.began))}{score}{curve}"


def sparkline(values: Sequence[float]) -> str:
    """The latest 20 values as bars, scaled from the least to the greatest; a gap for a value that is no number."""
    shown = values[-_BARS:]
    known = [value for value in shown if math.isfinite(value)]
    low, span = min(known, default=0.0), max(known, default=0.0) - min(known, default=0.0)
    heights = [round(7 * (value - low) / span) if span else 3 for value in shown if math.isfinite(value)]
    bars = iter(heights)
    return "".join("▁▂▃▄▅▆▇█"[next(bars)] if math.isfinite(value) else " " for value in shown)


def draws(console: Console) -> bool:
    """Whether the console shows bars: it is a terminal, and its encoding has them."""
    return console.is_terminal and console.encoding.lower().startswith("utf")


def _score(satisfaction: float, robustness: float) -> str:
    return f"; satisfied {100 * satisfaction:.0f} %, robustness {robustness:.3f}"


def duration(seconds: float) -> str:
    """ "12 s", "3 min 5 s", "2 h 10 min"."""
    minutes, rest = divmod(round(seconds), 60)
    if minutes >= 60:
        return f"{minutes // 60} h {minutes % 60} min"
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
