"""Items on a worker of another engine: what it is sent, its slots, and what is installed there."""

from __future__ import annotations

import pickle
import platform
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from importlib.metadata import distributions
from multiprocessing import connection
from pathlib import Path
from typing import Any

from stlbench.contract import Outcome, Work, cause
from stlbench_executors import slot as slots
from stlbench_executors.cell import Answer
from stlbench_executors.keeper import Ended, Task
from stlbench_executors.slot import UNTAKEN, Site, Slot

LOOK_SECONDS = 0.5
"""How often it is asked whether an item is still wanted."""


class Crew:
    """Slots for so many threads, which run items in processes of their own as the executor `local` does.

    Args:
        memory: bytes that the processes of one item may take together.
        prepare: pickled: what to call once, before the first item.
        size: how many items run at the same time, at most.
    """

    def __init__(self, memory: int, prepare: bytes, size: int) -> None:
        site = Site(memory, prepare)
        self._slots = [Slot(site) for _ in range(size)]
        self._free = list(self._slots)
        self._change = threading.Condition()
        self._is_over = self._has_started = False

    def run(self, task: Task, is_wanted: Callable[[], bool] = lambda: True) -> Ended:
        """How the item ended. One that nobody wants any more is ended; `is_wanted` is asked every half second."""
        slot = self._taken()
        try:
            return _ended(slot, task, lambda: not self._is_over and is_wanted())
        finally:
            with self._change:
                self._free.append(slot)
                self._change.notify_all()

    def _taken(self) -> Slot:
        with self._change:
            if not self._has_started:
                slots.start(self._slots)
                self._has_started = True
            self._change.wait_for(lambda: bool(self._free))
            return self._free.pop()

    def close(self) -> None:
        """End what runs, and all processes that were started."""
        with self._change:
            self._is_over = True
            self._change.wait_for(lambda: len(self._free) == len(self._slots), timeout=2 * slots.STOP_SECONDS)
        slots.stop(self._slots)


def _ended(slot: Slot, task: Task, is_wanted: Callable[[], bool]) -> Ended:
    if slot.link is None:
        slots.start([slot])
    is_taken = False
    while slot.link is not None:
        if not is_taken and slot.is_idle:
            is_taken = slot.take(task)
            continue
        if connection.wait([slot.link], timeout=LOOK_SECONDS) and (ended := slot.heard()) is not None:
            return ended
        slot.look()
        if not is_wanted():
            slot.stop()
            slot.wait(time.monotonic() + slots.STOP_SECONDS)
            return Ended("killed", reason="it was not wanted any more")
    return Ended("killed", reason=UNTAKEN)


class Order:
    """The arguments of `Executor.run`, checked.

    Raises:
        ValueError: an item has no deadline.
    """

    def __init__(self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]) -> None:
        if len(deadlines) != len(items) or any(deadline <= 0 for deadline in deadlines):
            raise ValueError("each item needs a deadline, in seconds and greater than 0")
        self.work = function if isinstance(function, Work) else Work(function)
        self._items, self.deadlines = items, deadlines

    def __len__(self) -> int:
        return len(self._items)

    @property
    def prepare(self) -> bytes:
        """Pickled: what many items need (`Work.prepare`)."""
        return pickle.dumps(self.work.prepare)

    def task(self, index: int) -> Task:
        """What the keeper of an item is given."""
        item = self._items[index]
        log = None if self.work.log is None else Path(self.work.log(item)).absolute()
        facts = b"" if self.work.facts is None else pickle.dumps(self.work.facts)
        return Task(pickle.dumps((self.work.function, item)), self.deadlines[index], log, facts)


def outcome_of(index: int, said: Ended) -> Outcome:
    """How an item ended, for the harness."""
    return replace(_outcome_of(index, said), facts=said.facts or {})


def _outcome_of(index: int, said: Ended) -> Outcome:
    if said.status != "answered":
        return Outcome(index, said.status, reason=said.reason)
    try:
        answer = Answer(*pickle.loads(said.answer))  # noqa: S301 - from our own process
        if answer.reason:
            return Outcome(index, "raised", reason=answer.reason, details=answer.details)
        return Outcome(index, "done", pickle.loads(answer.value))  # noqa: S301 - as above
    except Exception as error:
        return Outcome(index, "raised", reason=cause(error), details=traceback.format_exc())


PYTHON = "Python"


def installed() -> dict[str, str]:
    """Versions: of Python without its last number, of stlbench, and of every distribution with a plugin for it."""
    found = {PYTHON: ".".join(platform.python_version_tuple()[:2])}
    for distribution in distributions():
        with suppress(Exception):  # one whose files are damaged has no plugin that could be used
            if "[stlbench." in (distribution.read_text("entry_points.txt") or ""):
                found.setdefault(distribution.name, distribution.version)  # the first on the path counts
    return found


def difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """What is not alike, for a person: "stlbench-rl is 1.2.0 there, and here 1.3.0"; empty where all is."""
    return "; ".join(
        f"{name} is {there.get(name, 'not installed')} there, and here {here.get(name, 'not installed')}"
        for name in sorted(there.keys() | here.keys())
        if there.get(name) != here.get(name)
    )
