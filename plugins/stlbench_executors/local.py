"""Processes on this machine: `jobs` at a time, a fresh one for each item (`pool`)."""

import os
from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace
from multiprocessing import connection
from typing import Annotated, Any

from pydantic import Field

from stlbench.contract import Executor, Outcome
from stlbench_executors import pool as pools
from stlbench_executors.item_process import Memory, share
from stlbench_executors.pool import UNTAKEN, Pool, Slot
from stlbench_executors.worker import WorkItems, outcome_of


class LocalExecutor(Executor):
    """Processes on this machine, each with one thread for linear algebra.

    Each item has a process of its own, which ends with the item, and with it all that the item has started. No item
    sees the changes that another one makes in modules, settings or open files. A deadline counts from when the item's
    process is there, with what the harness needs imported.

    Args:
        jobs: items at a time; None for two, or one on a single core.
        memory: bytes for one item; None for its share of nine tenths of the machine's.

    Attributes:
        memory: bytes that the processes of one item may take together; it is killed if they take more.
    """

    def __init__(self, *, jobs: Annotated[int, Field(ge=1)] | None = None, memory: Memory | None = None) -> None:
        super().__init__(jobs=jobs or min(2, os.cpu_count() or 1))
        self.memory = memory or share(self.jobs)

    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:
        work = WorkItems(function, items, deadlines)
        if len(work) == 0:
            return
        pool = Pool(self.memory, work.prepare, min(self.jobs, len(work)))
        try:
            pool.start(pool.slots)
            yield from _outcomes(work, pool.slots)
        finally:
            pool.stop()


def _outcomes(work: WorkItems, slots: Sequence[Slot]) -> Generator[Outcome]:
    waiting, running = deque(range(len(work))), dict[Slot, int]()
    while waiting or running:
        for slot in slots:
            if waiting and slot.is_idle and slot.take(work.task(waiting[0])):
                running[slot] = waiting.popleft()
        links = {slot.link: slot for slot in slots if slot.link is not None}
        if not links:
            yield from (Outcome(index, "killed", reason=UNTAKEN) for index in waiting)
            return
        ready = connection.wait(list(links), timeout=min(pools.CHECK_SECONDS, pools.START_SECONDS / 4))
        for link, slot in links.items():
            if link in ready and (ended := slot.receive()) is not None:
                yield replace(outcome_of(running.pop(slot), ended), facts=None)
        for slot in slots:
            slot.check()
