"""A run on workers of Dask: what happens on a worker, and the loop that sends items and collects outcomes.

Of Dask a worker uses only the thread that waits. The keeper has deadline, memory, output and end of an item.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import time
import warnings
from collections import deque
from collections.abc import Generator, Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any, NamedTuple

from stlbench.contract import Outcome, Unsuitable, cause
from stlbench_executors.keeper import Ended, Task
from stlbench_executors.memory import share
from stlbench_executors.worker import Crew, Order, difference, installed, outcome_of

if TYPE_CHECKING:
    from distributed import Client, Future, Worker

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


LOOK_SECONDS = 1.0
"""How often, at most, it is looked at which workers there are."""

ALONE_SECONDS = 10.0
"""A user who has started no worker by then is told."""

OFFERS = 2
"""To so many workers an item is sent, where each before was lost."""


SILENCE_SECONDS = 600.0
"""A worker from which nothing is heard so long after the deadline of an item is no longer waited for."""


class _Flight(NamedTuple):
    """An item that a worker has."""

    key: str
    """Dask's name of the call."""
    item: int
    """Which."""
    worker: str
    """Its address."""
    future: Future[Ended | None]
    end: float
    """When it is no longer waited for, by the monotonic clock."""


class DaskRun:
    """What is to be run, where it runs, and what has ended.

    Args:
        client: of the scheduler.
        run: what the workers are told of the run.
        order: the items.
        most: items at a time.
        address: of the scheduler, for a user who has started no worker.
    """

    def __init__(self, client: Client, run: Run, order: Order, most: int, address: str) -> None:
        from distributed import as_completed

        self._client, self._run, self._order, self._most, self._address = client, run, order, most, address
        self._waiting = deque(range(len(order)))
        self._offers = dict.fromkeys(range(len(order)), 0)
        self._flights, self._over = dict[str, _Flight](), deque[Outcome]()
        self._free, self._refused = dict[str, int](), set[str]()
        self._landed = as_completed(loop=client.loop, with_results=True, raise_errors=False)
        self._begin, self._next_look, self._has_told = time.monotonic(), 0.0, False

    def outcomes(self) -> Generator[Outcome]:
        """One for each item, as they end. Raises `Unsuitable` where scheduler or workers cannot be used."""
        while self._waiting or self._flights:
            if time.monotonic() >= self._next_look:
                self._look()
            self._send()
            if not self._landed.has_ready():
                with self._landed.thread_condition:
                    self._landed.thread_condition.wait(0.05)
            for future, said in self._landed.next_batch(block=False):
                self._take(future, said)
            self._send()  # what the caller does with outcomes may take a while
            while self._over:
                yield self._over.popleft()

    # ----------------------------------------------------------------------------------------------------- workers

    def _look(self) -> None:
        """Which workers there are now: new ones join, and what lost ones had is offered again."""
        begin = time.monotonic()
        there = self._present()
        for worker in self._free.keys() - there.keys():
            del self._free[worker]
        for flight in [flight for flight in self._flights.values() if flight.worker not in there]:
            self._forget(flight)
            self._lose(flight)
        for flight in [flight for flight in self._flights.values() if flight.end < begin]:
            self._forget(flight)
            self._over.append(Outcome(flight.item, "timeout", reason="its worker does not answer", facts={}))
        self._join({worker: threads for worker, threads in there.items() if worker not in self._known})
        self._tell_if_alone()
        took = time.monotonic() - begin
        self._next_look = time.monotonic() + max(LOOK_SECONDS, 10 * took)

    @property
    def _known(self) -> set[str]:
        return self._free.keys() | self._refused

    def _present(self) -> dict[str, int]:
        """Address and threads of each worker."""
        try:
            return dict(self._client.nthreads())
        except (OSError, TimeoutError, ValueError) as error:
            said = (
                "the Dask scheduler does not answer any more; what ended before is recorded, and the same call goes on"
            )
            raise Unsuitable(f"{said} ({cause(error)})") from error

    def _join(self, new: dict[str, int]) -> None:
        if not new:
            return
        answers = self._client.run(join, self._run, workers=list(new), on_error="return")
        for worker, said in answers.items():
            if isinstance(said, OSError):  # it went away again, or will be asked once more
                continue
            if problem := said if isinstance(said, str) else cause(said):
                self._refuse(worker, problem)
            else:
                held = sum(flight.worker == worker for flight in self._flights.values())
                self._free[worker] = new[worker] - held

    def _refuse(self, worker: str, problem: str) -> None:
        """At the beginning, the run; later, when others do their work, the worker alone."""
        if not any(self._offers.values()):
            raise Unsuitable(f"worker {worker} cannot be used: {problem}")
        self._refused.add(worker)
        warnings.warn(f"worker {worker} is not used: {problem}", stacklevel=2)

    def _tell_if_alone(self) -> None:
        if not self._free and not self._has_told and time.monotonic() - self._begin > ALONE_SECONDS:
            self._has_told = True
            start = f"dask worker {self._address} --nthreads 1 --no-nanny --memory-limit 0"
            warnings.warn(f"waiting for a worker; one is started by `{start}`", stacklevel=2)

    # ------------------------------------------------------------------------------------------------------- items

    def _send(self) -> None:
        while self._waiting and len(self._flights) < self._most:
            worker = max(self._free, key=self._free.__getitem__, default=None)
            if worker is None or self._free[worker] <= 0:
                return
            self._send_to(worker, self._waiting.popleft())

    def _send_to(self, worker: str, index: int) -> None:
        self._free[worker] -= 1
        self._offers[index] += 1
        key = f"{self._run.name}-{index}-{self._offers[index]}"
        task = self._order.task(index)
        future = self._client.submit(
            *(run_item, self._run.name, task, key), key=key, workers=[worker], allow_other_workers=False, retries=0
        )
        end = time.monotonic() + task.deadline + SILENCE_SECONDS
        self._flights[key] = _Flight(key, index, worker, future, end)
        self._landed.add(future)

    def _take(self, future: Future[Ended | None], said: Any) -> None:
        """What became of a call."""
        from distributed import KilledWorker

        flight = self._flights.get(str(future.key))
        if flight is None:
            return  # of a worker that was lost
        status = future.status
        self._forget(flight)  # after which it is cancelled
        if flight.worker in self._free:
            self._free[flight.worker] += 1
        if status == "finished" and isinstance(said, Ended):
            self._over.append(outcome_of(flight.item, said))
        elif status == "error" and not isinstance(said[1], KilledWorker):
            reason = f"its worker could not run it: {cause(said[1])}"
            self._over.append(Outcome(flight.item, "killed", reason=reason, facts={}))
        else:
            self._present()  # or the scheduler is gone, and no worker to blame
            self._free.pop(flight.worker, None)  # where it is there, it joins again
            self._lose(flight)

    def _lose(self, flight: _Flight) -> None:
        if self._offers[flight.item] < OFFERS:
            self._waiting.appendleft(flight.item)
        else:
            reason = f"the worker that ran it was lost, {OFFERS} times"
            self._over.append(Outcome(flight.item, "killed", reason=reason, facts={}))

    def _forget(self, flight: _Flight) -> None:
        del self._flights[flight.key]
        flight.future.release()

    def close(self) -> None:
        """Stop what runs, and have the workers end all that they started for this run."""
        with suppress(Exception):  # a scheduler that is not there any more
            self._client.cancel([flight.future for flight in self._flights.values()], force=True)
            self._client.run(leave, self._run.name, workers=list(self._free), on_error="ignore")
