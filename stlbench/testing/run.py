"""The rules of what surrounds a run: an executor, whose items may return, raise, take too long or end their process,
and a log.
"""

import math
import os
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import psutil

from stlbench.contract import Executor, LoggedCell, LoggedCheckpoint, Outcome, RunLog, Work
from stlbench.testing.rules import Rules, made

_PATIENCE = 600.0  # deadline, in seconds, of items that end by themselves
_SHORT = 3.0  # deadline of the item that sleeps for `_LONG`
_LONG = 60.0
_MARK = "STLBENCH_CHECK_EXECUTOR"  # an environment variable that nobody sets

Place = tuple[str, int]


class _Item(NamedTuple):
    """A worker's order: "return", "raise", "sleep", "exit", "place", "change", "look" or "leave"."""

    what: str
    number: int = 0


_APART = ("place", "change", "look", "leave")
_ACCIDENTS = (_Item("raise", 7), _Item("exit", 3), _Item("sleep"), _Item("exit", 0), *[_Item("return", 1)] * 3)


def check_executor(executor: type[Executor] | str, rules: Rules | None = None) -> None:
    """Check an executor on small items, with one and with two jobs. It takes some seconds on a machine at rest.

    The rules: each item has one outcome, with its value; with one job they come in order; an item that raises, passes
    its deadline or ends its process is told as that, in one line, and leaves the others alone; items run in another
    process than this one, and see nothing that another has changed in its own; outcomes say on which machine, where
    that is another; a process that an item starts ends with it; closing the iterator stops what runs.

    Args:
        executor: a class, or the name of an installed executor with parameters other than `jobs`.
        rules: takes those that are kept, for a caller that lists them.

    Raises:
        AssertionError: the rule that is broken.
        UsageError: no such executor, or a wrong parameter; the message says what there is.
    """
    rules, one, two = rules or Rules(), made("executors", executor, jobs=1), made("executors", executor, jobs=2)
    rules.keep(list(one.run(_work, [], [])) == [], "no items have no outcomes", "some")
    in_order = _run(one, [*(_Item("return", 10 * number) for number in range(4)), *map(_Item, _APART)])
    together = sorted(_run(two, _ACCIDENTS, [_PATIENCE, _PATIENCE, _SHORT, *[_PATIENCE] * 4]), key=lambda o: o.index)
    _check_values(in_order, together, rules)
    _check_raise(together[0], rules)
    _check_apart(in_order[4:], rules)
    _check_accidents(together[1:], rules)
    _check_close(two, rules)


def _work(item: _Item, home: Place = ("", 0)) -> Any:
    """The work of a worker. Nothing that would harm this process is done in it."""
    if item.what == "raise":
        raise ValueError(f"item {item.number}\nof two lines")
    if item.what == "place" or (item.what in ("sleep", "exit", "change", "leave") and home == _place()):
        return _place()
    if item.what == "sleep":
        time.sleep(_LONG)
    if item.what == "exit":
        os._exit(item.number)
    if item.what == "change":
        os.environ[_MARK] = "changed"
    if item.what == "look":
        return os.environ.get(_MARK)
    if item.what == "leave":
        left = subprocess.Popen([sys.executable, "-c", f"import time; time.sleep({_LONG})"])  # noqa: S603
        return socket.gethostname(), left.pid
    return item.number


def _facts() -> dict[str, str]:
    return {"host": socket.gethostname()}


def _place() -> Place:
    return socket.gethostname(), os.getpid()


def _run(executor: Executor, items: Sequence[_Item], deadlines: Sequence[float] = ()) -> list[Outcome]:
    work = Work(partial(_work, home=_place()), facts=_facts)
    return list(executor.run(work, items, deadlines or [_PATIENCE] * len(items)))


def _check_values(in_order: Sequence[Outcome], together: Sequence[Outcome], rules: Rules) -> None:
    indices = [outcome.index for outcome in in_order]
    rules.keep(indices == list(range(4 + len(_APART))), "with one job, items end in their order", indices)
    found = [outcome.index for outcome in together]
    rules.keep(found == list(range(len(_ACCIDENTS))), "each item has one outcome", found)
    for outcome in in_order[:4]:
        rules.keep(outcome.status == "done", "an item that returns is done", outcome)
        rules.keep(outcome.value == 10 * outcome.index, "an outcome has the value of its own item", outcome)


def _check_raise(raised: Outcome, rules: Rules) -> None:
    rules.keep(raised.status == "raised", "an item that raises has raised", raised)
    said = raised.reason.startswith("ValueError: item 7") and "\n" not in raised.reason
    rules.keep(said, "the exception is the reason, in one line", repr(raised.reason))
    rules.keep("_work" in raised.details, "the traceback is in the details", repr(raised.details))


def _check_apart(ended: Sequence[Outcome], rules: Rules) -> None:
    placed, changed, looked, left = ended
    rules.keep(tuple(placed.value) != _place(), "items run in another process than the caller's", placed.value)
    said = _facts() if placed.facts is None else placed.facts or None
    right = said in (None, {"host": placed.value[0]})
    rules.keep(right, "`Outcome.facts` are of the machine on which the item ran, None of the caller's", placed.facts)
    kept = changed.status == "done" and looked.value is None
    rules.keep(kept, "what an item changes in its process, the next one does not see", looked.value)
    host, process = left.value
    over = host != socket.gethostname() or not psutil.pid_exists(process)
    rules.keep(over, "a process that an item has started ends with it", f"process {process} goes on")


def _check_accidents(ended: Sequence[Outcome], rules: Rules) -> None:
    killed, late, quiet, *others = ended
    for gone in (killed, quiet):
        rules.keep(gone.status == "killed" and gone.reason != "", "an item that ends its process is killed", gone)
    rules.keep(late.status == "timeout", "an item is stopped at its deadline, as timeout", late)
    done = [outcome.status for outcome in others] == ["done"] * 3
    rules.keep(done, "such accidents leave the other items alone", others)


def _check_close(executor: Executor, rules: Rules) -> None:
    begin = time.monotonic()
    items, deadlines = [_Item("return"), _Item("sleep"), _Item("sleep")], [_PATIENCE] * 3
    with closing(executor.run(partial(_work, home=_place()), items, deadlines)) as outcomes:
        next(outcomes)
    took = time.monotonic() - begin
    rules.keep(took < _LONG, "closing the iterator stops what runs", f"an end after {took:.0f} s, of its own accord")


_CALL_SECONDS = 30.0  # seconds that one call may take
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
    rules.keep(longest < _CALL_SECONDS, f"no call takes more than {_CALL_SECONDS:g} s", f"one of {longest:.0f} s")
