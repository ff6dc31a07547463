"""Items for workers of any engine: the items, the pool that runs them on a worker, and the versions there."""

import pickle
import platform
import threading
import time
import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from importlib.metadata import distributions
from multiprocessing import connection
from pathlib import Path
from typing import Any

from stlbench.contract import Outcome, Work, cause
from stlbench_executors.item_process import Answer
from stlbench_executors.pool import STOP_SECONDS, UNTAKEN, Pool, Slot
from stlbench_executors.supervisor import Ended, Task

CHECK_SECONDS = 0.5  # between two checks whether an item is still wanted


class WorkerPool(Pool):
    """A pool for threads: each runs one item at a time, in a process of its own as the executor `local` does."""

    def __init__(self, memory: int, prepare: bytes, size: int) -> None:
        super().__init__(memory, prepare, size)
        self._free = list(self.slots)
        self._change = threading.Condition()
        self._is_closed = self._has_started = False

    def run(self, task: Task, is_wanted: Callable[[], bool] = lambda: True) -> Ended:
        """Wait for a free slot and run an item there; end it when `is_wanted`, called twice a second, says no."""
        with self._change:
            if not self._has_started:
                self.start(self.slots)
                self._has_started = True
            self._change.wait_for(lambda: bool(self._free))
            slot = self._free.pop()
        try:
            return self._run_in(slot, task, is_wanted)
        finally:
            with self._change:
                self._free.append(slot)
                self._change.notify_all()

    def _run_in(self, slot: Slot, task: Task, is_wanted: Callable[[], bool]) -> Ended:
        if slot.link is None:
            self.start([slot])
        is_taken = False
        while slot.link is not None:
            if not is_taken and slot.is_idle:
                is_taken = slot.take(task)
                continue
            if connection.wait([slot.link], timeout=CHECK_SECONDS) and (ended := slot.receive()) is not None:
                return ended
            slot.check()
            if self._is_closed or not is_wanted():
                slot.stop()
                slot.wait(time.monotonic() + STOP_SECONDS)
                return Ended("killed", reason="it was not wanted any more")
        return Ended("killed", reason=UNTAKEN)

    def close(self) -> None:
        with self._change:
            self._is_closed = True
            self._change.wait_for(lambda: len(self._free) == len(self.slots), timeout=2 * STOP_SECONDS)
        self.stop()


class WorkItems:
    """The arguments of `Executor.run`. Raises `ValueError` if an item has no deadline."""

    def __init__(self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]) -> None:
        if len(deadlines) != len(items) or any(deadline <= 0 for deadline in deadlines):
            raise ValueError("each item needs a deadline, in seconds and greater than 0")
        self.work = function if isinstance(function, Work) else Work(function)
        self._items, self.deadlines = items, deadlines

    def __len__(self) -> int:
        return len(self._items)

    @property
    def prepare(self) -> bytes:
        return pickle.dumps(self.work.prepare)

    def task(self, index: int) -> Task:
        item = self._items[index]
        log = None if self.work.log is None else Path(self.work.log(item)).absolute()
        facts = b"" if self.work.facts is None else pickle.dumps(self.work.facts)
        return Task(pickle.dumps((self.work.function, item)), self.deadlines[index], log, facts)


def outcome_of(index: int, ended: Ended) -> Outcome:
    facts = ended.facts or {}
    if ended.status != "answered":
        return Outcome(index, ended.status, reason=ended.reason, facts=facts)
    try:
        answer = Answer(*pickle.loads(ended.answer))  # noqa: S301 - from our own process
        if answer.reason:
            return Outcome(index, "raised", reason=answer.reason, details=answer.details, facts=facts)
        return Outcome(index, "done", pickle.loads(answer.value), facts=facts)  # noqa: S301 - as above
    except Exception as error:
        return Outcome(index, "raised", reason=cause(error), details=traceback.format_exc(), facts=facts)


def installed() -> dict[str, str]:
    """Versions of Python (without its last number), of stlbench, and of every distribution with a plugin for it."""
    versions = {"Python": ".".join(platform.python_version_tuple()[:2])}
    for distribution in distributions():
        with suppress(Exception):  # one whose files are damaged has no plugin that could be used
            if "[stlbench." in (distribution.read_text("entry_points.txt") or ""):
                versions.setdefault(distribution.name, distribution.version)  # the first on the path counts
    return versions


def difference(there: Mapping[str, str], here: Mapping[str, str]) -> str:
    """Each version that differs: "stlbench-rl is 1.2.0 there, and here 1.3.0"; empty if none does."""
    return "; ".join(
        f"{name} is {there.get(name, 'not installed')} there, and here {here.get(name, 'not installed')}"
        for name in sorted(there.keys() | here.keys())
        if there.get(name) != here.get(name)
    )
