"""The rules of a log: it takes the events of a run, in their order."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

from stlbench.contract import LoggedCell, LoggedCheckpoint, RunLog
from stlbench.testing.rules import Rules, made

_LONG = 30.0  # seconds that one call may take
_CELLS = ("hold-disc/funnel/dqn/0", "overlap[without=cuts]/funnel[ginf=0.02,t_star=1]/dqn/1/tuned", "a/b/c/2")
_NUMBERS = {"satisfaction": 1.0, "robustness": 0.3, "env_steps": 4000.0}


def check_log(log: type[RunLog] | str, rules: Rules | None = None) -> None:
    """Check a log on a made-up run, in a temporary folder. The check itself sends nothing.

    The rules: it takes a run of no cells; checkpoints of several cells in turn; cells that ended with and without
    checkpoints, numbers that are none, and results without any; cells that never end; a second run in the same folder,
    which says the same cells again; no call takes more than 30 seconds.

    Args:
        log: a class, or the name of an installed log with parameters.
        rules: takes those that are kept, for a caller that lists them.

    Raises:
        AssertionError: the rule that is broken.
        UsageError: no such log, or a wrong parameter; the message says what there is.
    """
    rules = rules or Rules()
    with tempfile.TemporaryDirectory() as name:
        for rule, cells, ends in _runs():
            _play(made("logs", log), Path(name), cells, ends, rule, rules)


def _runs() -> Iterator[tuple[str, Sequence[str], Sequence[LoggedCell]]]:
    """Rules, and the names and the ends of cells that each is about."""
    yield "it takes a run of no cells", (), ()
    ends = [_done(_CELLS[0]), _done(_CELLS[1]), LoggedCell(_CELLS[2], "quick", "raised", "ValueError: no")]
    yield "it takes several cells, and how they ended", _CELLS, ends
    yield "it takes the same cells again, in a second run", _CELLS, ends
    odd = LoggedCheckpoint(_CELLS[0], 1000, math.nan, -math.inf)
    lost = LoggedCell(_CELLS[0], "quick", "done", "", {"robustness": math.nan, "new": 1.0}, (odd,))
    yield "it takes numbers that are none, and others than today's", _CELLS[:1], [lost]
    yield "it takes a run that ends before its cells do", _CELLS, []
    yield "it takes a cell of which there was no checkpoint", _CELLS[:1], [LoggedCell(_CELLS[0], "quick", "done")]


def _done(cell: str) -> LoggedCell:
    curve = tuple(LoggedCheckpoint(cell, 1000 * i, 0.5, 0.1 * i) for i in (1, 2, 3, 4))
    return LoggedCell(cell, "quick", "done", "", _NUMBERS, curve)


def _play(
    log: RunLog,
    folder: Path,
    cells: Sequence[str],
    ends: Sequence[LoggedCell],
    rule: str,
    rules: Rules,
) -> None:
    calls: list[Callable[[], None]] = [partial(log.begin, folder, tuple(cells))]
    calls += [partial(log.ended, end) for end in ends]
    longest = 0.0
    for call in [*calls, log.end]:
        began = time.monotonic()
        try:
            call()
        except (Exception, SystemExit) as error:
            rules.keep(False, rule, f"{type(error).__name__}: {error}")
        longest = max(longest, time.monotonic() - began)
    rules.keep(True, rule, "")
    rules.keep(longest < _LONG, f"no call takes more than {_LONG:g} s", f"one of {longest:.0f} s")
