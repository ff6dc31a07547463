"""What runs just now, in words."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stlbench.study import running
from stlbench.study.running import Running

if TYPE_CHECKING:
    from rich.console import Console

MOST = 8
"""Cells that are listed; the others are counted."""
_BARS = 20


class Sight:
    """Looks at most once a second at which cells run."""

    def __init__(self, folder: Path | None) -> None:
        self._folder, self._seen, self._at = folder, list[Running](), -1.0

    def look(self) -> list[Running]:
        """The cells that run; none where there is no folder."""
        now = time.time()
        if self._folder is not None and now - self._at >= 1:
            self._seen, self._at = running.running(self._folder), now
        return self._seen


def line_of(one: Running, now: float, *, drawn: bool = False) -> str:
    """hold-disc/funnel/dqn/3: 42 %, 16,800 of 40,000 steps, 12 s; satisfied 88 %, robustness 0.310.

    Where it is `drawn`, for a terminal, with the robustness of the checkpoints so far: ▁▃▅▇.
    """
    score = "" if one.satisfaction is None or one.robustness is None else _score(one.satisfaction, one.robustness)
    done = f"{100 * one.share:.0f} %, {one.steps:,} of {one.of:,} steps" if one.share < 1 else "trained, is scored"
    curve = f" {sparkline([mean for _, _, mean in one.curve])}" if drawn and one.curve else ""
    return f"{one.name}: {done}, {duration(max(0.0, now - one.began))}{score}{curve}"


def sparkline(values: Sequence[float]) -> str:
    """At most 20 values as bars, the latest, from the least of them to the greatest; a gap where one is no number."""
    shown = values[-_BARS:]
    known = [value for value in shown if math.isfinite(value)]
    low, span = min(known, default=0.0), max(known, default=0.0) - min(known, default=0.0)
    heights = [round(7 * (value - low) / span) if span else 3 for value in shown if math.isfinite(value)]
    bars = iter(heights)
    return "".join("▁▂▃▄▅▆▇█"[next(bars)] if math.isfinite(value) else " " for value in shown)


def draws(console: Console) -> bool:
    """Whether bars can be seen: on a terminal, not in a pipe, and in an encoding that has them."""
    return console.is_terminal and console.encoding.lower().startswith("utf")


def _score(satisfaction: float, robustness: float) -> str:
    return f"; satisfied {100 * satisfaction:.0f} %, robustness {robustness:.3f}"


def duration(seconds: float) -> str:
    """ "12 s", "3 min 5 s", "2 h 10 min"."""
    minutes, rest = divmod(round(seconds), 60)
    return (
        f"{minutes // 60} h {minutes % 60} min"
        if minutes >= 60
        else f"{minutes} min {rest} s"
        if minutes
        else f"{rest} s"
    )
