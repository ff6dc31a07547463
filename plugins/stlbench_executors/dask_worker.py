"""What happens on a worker of Dask: items of a run, in slots of ours, as many as the worker has threads.

Of Dask the worker has only the thread that waits. Deadline, memory, output and end of an item are its keeper's.
"""

from __future__ import annotations

import asyncio
import multiprocessing
from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

from stlbench_executors.crew import Crew
from stlbench_executors.keeper import Ended, Task
from stlbench_executors.memory import share
from stlbench_executors.versions import difference, installed

if TYPE_CHECKING:
    from distributed import Worker

__all__ = ["Run", "join", "leave", "run_item"]


class Run(NamedTuple):
    """What all items of a run have in common."""

    name: str
    """No other run's."""
    memory: int | None
    """Bytes for an item; None for a share of nine tenths of what the worker may take."""
    prepare: bytes
    """Pickled (`Work.prepare`)."""
    versions: Mapping[str, str]
    """Of where the items come from."""


_CREWS = dict[tuple[str, str], Crew]()
"""By run and address of the worker, of which a process may be several."""


def join(run: Run, dask_worker: Worker) -> str:
    """Get ready for the items of a run: an empty text, or why this worker cannot run them."""
    if other := difference(installed(), run.versions):
        return f"{other}; install the same versions there, and start the worker again"
    if multiprocessing.current_process().daemon:
        return "its nanny lets it start no processes; start it with --no-nanny"
    if (run.name, dask_worker.address) not in _CREWS:
        threads = dask_worker.state.nthreads
        _CREWS[run.name, dask_worker.address] = Crew(run.memory or share(threads), run.prepare, threads)
    return ""


def run_item(run: str, task: Task, key: str) -> Ended | None:
    """How an item ended; None where this worker has not joined the run, as one that was started again in its place.

    Args:
        run: its name.
        task: the item.
        key: Dask's name of this call, which it forgets where nobody wants the item any more.
    """
    from distributed import get_worker

    worker = get_worker()
    crew = _CREWS.get((run, worker.address))
    return None if crew is None else crew.run(task, lambda: _is_wanted(worker, key))


def _is_wanted(worker: Worker, key: str) -> bool:
    """It was not cancelled, the program that waits for it has not ended, and neither has the scheduler."""
    state = worker.state.tasks.get(key)
    is_over = worker.status.name in ("closing", "closed", "failed")
    return not is_over and state is not None and state.state == "executing"


async def leave(run: str, dask_worker: Worker) -> None:
    """End what runs of a run, and all that was started for it."""
    if crew := _CREWS.pop((run, dask_worker.address), None):
        await asyncio.to_thread(crew.close)
