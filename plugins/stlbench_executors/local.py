"""Processes on this machine: `jobs` at a time, a fresh one for each item (`slot`)."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from multiprocessing import connection
from typing import Annotated, Any

from pydantic import Field

from stlbench.contract import Executor, Outcome
from stlbench_executors import slot as slots_of
from stlbench_executors.memory import Memory, share
from stlbench_executors.slot import UNTAKEN, Site, Slot
from stlbench_executors.worker import Order, outcome_of


class LocalExecutor(Executor):
    """Processes on this machine, each with one thread for linear algebra.

    Each item has a process of its own, which ends with the item, and with it all that the item has started. What an
    item changes, in modules, settings or files that are open, no other item sees. A deadline counts from when the
    item's process is there, with what the harness needs imported.

    Args:
        jobs: items at a time; two where it is None, or one on a single core.
        memory: bytes for one item; where it is None, its share of nine tenths of the machine's.

    Attributes:
        memory: bytes that the processes of one item may take together; it is killed where they take more.
    """

    def __init__(self, *, jobs: Annotated[int, Field(ge=1)] | None = None, memory: Memory | None = None) -> None:
        super().__init__(jobs=jobs or min(2, os.cpu_count() or 1))
        self.memory = memory or share(self.jobs)

    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:
        """See `Executor.run`."""
        order = Order(function, items, deadlines)
        site = Site(self.memory, order.prepare)
        slots = [Slot(site) for _ in range(min(self.jobs, len(order)))]
        if not slots:
            return
        try:
            slots_of.start(slots)
            yield from _outcomes(order, slots)
        finally:
            slots_of.stop(slots)


def _outcomes(order: Order, slots: Sequence[Slot]) -> Generator[Outcome]:
    waiting, held = deque(range(len(order))), dict[Slot, int]()
    while waiting or held:
        for slot in slots:
            if waiting and slot.is_idle and slot.take(order.task(waiting[0])):
                held[slot] = waiting.popleft()
        links = {slot.link: slot for slot in slots if slot.link is not None}
        if not links:
            yield from (Outcome(index, "killed", reason=UNTAKEN) for index in waiting)
            return
        ready = connection.wait(list(links), timeout=min(slots_of.LOOK_SECONDS, slots_of.START_SECONDS / 4))
        for link, slot in links.items():
            if link in ready and (ended := slot.heard()) is not None:
                yield replace(outcome_of(held.pop(slot), ended), facts=None)
        for slot in slots:
            slot.look()
