"""A slot for a thread that runs one item after the other, as a worker of another engine does."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from multiprocessing import connection

from stlbench_executors import slot as slots
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
