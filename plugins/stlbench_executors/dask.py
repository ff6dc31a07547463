"""Workers of a Dask scheduler. Dask moves items there and outcomes back; all else is done as by `local`.

Dask repeats the task of a worker that died up to three times, knows no deadline, and lets tasks wait at a worker. So
each item is sent to one worker that has a free place. There a thread of Dask only waits, and a supervisor sees to
deadline, memory, output and end of the item.
"""

from __future__ import annotations

import asyncio
import multiprocessing
import re
import time
import uuid
import warnings
from collections import deque
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from pydantic import Field

from stlbench.contract import Executor, Outcome, Unsuitable, cause
from stlbench_executors.item_process import Memory, share
from stlbench_executors.supervisor import Ended, Task
from stlbench_executors.worker import WorkerPool, WorkItems, difference, installed, outcome_of

if TYPE_CHECKING:
    from distributed import Client, Future, Worker


class Run(NamedTuple):
    """The common part of all items of a run."""

    name: str  # unique
    memory: int | None  # bytes for an item; None for the worker's share of the machine (`share`)
    prepare: bytes  # pickled (`Work.prepare`)
    versions: Mapping[str, str]  # those on the machine that sends the items


_POOLS = dict[tuple[str, str], WorkerPool]()  # (run, address of a worker); a process may be several workers


def join(run: Run, dask_worker: Worker) -> str:
    """Make a pool for the items of a run: an empty text, or the reason why this worker cannot run them."""
    if other := difference(installed(), run.versions):
        return f"{other}; install the same versions there, and start the worker again"
    if multiprocessing.current_process().daemon:
        return "its nanny lets it start no processes; start it with --no-nanny"
    if (run.name, dask_worker.address) not in _POOLS:
        threads = dask_worker.state.nthreads
        _POOLS[run.name, dask_worker.address] = WorkerPool(run.memory or share(threads), run.prepare, threads)
    return ""


def run_item(run: str, task: Task, key: str) -> Ended | None:
    """The end of an item; None if this worker has not joined the run of that name, as after a restart.

    Dask forgets the `key` of this call when nobody wants the item any more.
    """
    from distributed import get_worker

    worker = get_worker()
    pool = _POOLS.get((run, worker.address))
    return None if pool is None else pool.run(task, lambda: _is_wanted(worker, key))


def _is_wanted(worker: Worker, key: str) -> bool:
    """Neither was it cancelled, nor has the program that waits for it ended, nor the scheduler."""
    state = worker.state.tasks.get(key)
    is_over = worker.status.name in ("closing", "closed", "failed")
    return not is_over and state is not None and state.state == "executing"


async def leave(run: str, dask_worker: Worker) -> None:
    """End all processes of a run."""
    if pool := _POOLS.pop((run, dask_worker.address), None):
        await asyncio.to_thread(pool.close)


OFFERS = 2  # so often an item is begun if the worker before was lost
CHECK_SECONDS = 1.0  # between two checks which workers there are, at least
WARN_SECONDS = 10.0  # a user who has started no worker by then is warned
SILENCE_SECONDS = 600.0  # an item whose worker is silent so long after the deadline has timed out


class _SentItem(NamedTuple):
    key: str  # Dask's name of the call
    item: int
    worker: str  # its address
    future: Future[Ended | None]
    end: float  # when it has timed out, by the monotonic clock


class DaskRun:
    """Items that workers of Dask have, at most `most` at a time.

    They wait, are sent, and end; or they are lost with their worker, and sent once more.
    """

    def __init__(self, client: Client, run: Run, items: WorkItems, most: int, address: str) -> None:
        from distributed import as_completed

        self._items = items
        self._waiting, self._left = deque(range(len(items))), set(range(len(items)))
        self._offers = [0] * len(items)  # the times that each was sent
        self._over = deque[Outcome]()  # those that nobody has taken yet
        self._client, self._run, self._most, self._address = client, run, most, address
        self._sent = dict[str, _SentItem]()
        self._free, self._refused = dict[str, int](), set[str]()
        self._completed = as_completed(loop=client.loop, with_results=True, raise_errors=False)
        self._begin, self._next_check, self._has_warned = time.monotonic(), 0.0, False

    def outcomes(self) -> Generator[Outcome]:
        while self._left:
            self._turn()
            while self._over:
                yield self._over.popleft()
            if self._left:
                self._wait()

    def _turn(self) -> None:
        if time.monotonic() >= self._next_check:
            self._check()
        self._send()
        for future, result in self._completed.next_batch(block=False):
            self._take(future, result)
        self._send()  # before the caller gets outcomes, as it may take a while with them

    def _wait(self) -> None:
        if not self._completed.has_ready():
            with self._completed.thread_condition:
                self._completed.thread_condition.wait(0.05)

    def _check(self) -> None:
        """Let new workers join the run, and send the items of lost ones to others."""
        begin = time.monotonic()
        there = self._present()
        for worker in self._free.keys() - there.keys():
            del self._free[worker]
        for sent in [sent for sent in self._sent.values() if sent.worker not in there]:
            self._forget(sent)
            self._lose(sent.item)
        for sent in [sent for sent in self._sent.values() if sent.end < begin]:
            self._forget(sent)
            self._end(sent.item, Ended("timeout", reason="its worker does not answer"))
        self._join({worker: threads for worker, threads in there.items() if worker not in self._known})
        self._warn_without_workers()
        took = time.monotonic() - begin
        self._next_check = time.monotonic() + max(CHECK_SECONDS, 10 * took)

    @property
    def _known(self) -> set[str]:
        return self._free.keys() | self._refused

    def _present(self) -> dict[str, int]:
        try:
            return dict(self._client.nthreads())
        except (OSError, TimeoutError, ValueError) as error:
            raise Unsuitable(
                "the Dask scheduler does not answer any more; what ended before is recorded, and the same call goes on "
                f"({cause(error)})"
            ) from error

    def _join(self, new: dict[str, int]) -> None:
        if not new:
            return
        answers = self._client.run(join, self._run, workers=list(new), on_error="return")
        for worker, answer in answers.items():
            if isinstance(answer, OSError):  # it went away again, or is asked at the next check
                continue
            if problem := answer if isinstance(answer, str) else cause(answer):
                self._refuse(worker, problem)
            else:
                taken = sum(sent.worker == worker for sent in self._sent.values())
                self._free[worker] = new[worker] - taken

    def _refuse(self, worker: str, problem: str) -> None:
        """End the run if nothing was sent yet; else do without this worker."""
        if not any(self._offers):
            raise Unsuitable(f"worker {worker} cannot be used: {problem}")
        self._refused.add(worker)
        warnings.warn(f"worker {worker} is not used: {problem}", stacklevel=2)

    def _warn_without_workers(self) -> None:
        if not self._free and not self._has_warned and time.monotonic() - self._begin > WARN_SECONDS:
            self._has_warned = True
            start = f"dask worker {self._address} --nthreads 1 --no-nanny --memory-limit 0"
            warnings.warn(f"waiting for a worker; one is started by `{start}`", stacklevel=2)

    def _send(self) -> None:
        while self._waiting and len(self._sent) < self._most:
            worker = max(self._free, key=self._free.__getitem__, default=None)
            if worker is None or self._free[worker] <= 0:
                return
            self._send_to(worker, self._waiting.popleft())

    def _send_to(self, worker: str, index: int) -> None:
        self._free[worker] -= 1
        self._offers[index] += 1
        key = f"{self._run.name}-{index}-{self._offers[index]}"
        task = self._items.task(index)
        future = self._client.submit(
            *(run_item, self._run.name, task, key), key=key, workers=[worker], allow_other_workers=False, retries=0
        )
        end = time.monotonic() + task.deadline + SILENCE_SECONDS
        self._sent[key] = _SentItem(key, index, worker, future, end)
        self._completed.add(future)

    def _take(self, future: Future[Ended | None], result: Any) -> None:
        from distributed import KilledWorker

        sent = self._sent.get(str(future.key))
        if sent is None:
            return  # its worker was thought lost
        status = future.status
        self._forget(sent)  # after which it is cancelled
        if sent.worker in self._free:
            self._free[sent.worker] += 1
        if status == "finished" and isinstance(result, Ended):
            self._end(sent.item, result)
        elif status == "error" and not isinstance(result[1], KilledWorker):
            self._end(sent.item, Ended("killed", reason=f"its worker could not run it: {cause(result[1])}"))
        else:
            self._present()  # or the scheduler is gone, and no worker to blame
            self._free.pop(sent.worker, None)  # if it is there, it joins again
            self._lose(sent.item)

    def _forget(self, sent: _SentItem) -> None:
        del self._sent[sent.key]
        sent.future.release()

    def _end(self, index: int, ended: Ended) -> None:
        if index in self._left:  # else of a worker that was thought lost
            self._left.remove(index)
            self._over.append(outcome_of(index, ended))

    def _lose(self, index: int) -> None:
        """Have an item sent again, unless that has happened."""
        if self._offers[index] < OFFERS:
            self._waiting.appendleft(index)
        else:
            self._end(index, Ended("killed", reason=f"the worker that ran it was lost, {OFFERS} times"))

    def close(self) -> None:
        with suppress(Exception):  # the scheduler may be gone
            self._client.cancel([sent.future for sent in self._sent.values()], force=True)
            self._client.run(leave, self._run.name, workers=list(self._free), on_error="ignore")


CONNECT_SECONDS = 20.0
_ADDRESS = re.compile(r"inproc://.+|\w+://.+:\d+")
"""Dask refuses other addresses only after it has waited, and with a traceback."""


class DaskExecutor(Executor):
    """Workers of a Dask scheduler, on any number of machines: each thread of a worker runs one item at a time.

    Each item has a process of its own on its worker, with its deadline and its memory, as with `local`. An item whose
    worker is lost is offered to another one, once. Traces, policies and logs are written by the workers: the folder of
    results has to be on a disk that all share.

    Args:
        jobs: items at a time; None for as many as the workers have threads.
        memory: bytes for one item; None for its share, by the worker's threads, of nine tenths of the
            machine's.
        address: the scheduler's, as in tcp://node1:8786. If it is None, a scheduler and a worker are made for the run
            in this process.
    """

    def __init__(
        self,
        *,
        jobs: Annotated[int, Field(ge=1)] | None = None,
        memory: Memory | None = None,
        address: str | None = None,
    ) -> None:
        if find_spec("distributed") is None:
            raise Unsuitable('executor dask needs Dask: pip install "stlbench-rl[dask]"')
        if address is not None and not _ADDRESS.fullmatch(address):
            raise Unsuitable(f"executor dask: the address of a scheduler is like tcp://node1:8786, got {address}")
        super().__init__(jobs=jobs or (0 if address else 2))
        self.memory, self.address = memory, address

    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:

        work = WorkItems(function, items, deadlines)
        if len(work) == 0:
            return
        with _connected(self.address, self.jobs) as client:
            run = Run(f"stlbench-{uuid.uuid4().hex[:12]}", self.memory, work.prepare, installed())
            running = DaskRun(client, run, work, self.jobs or len(work), self.address or "")
            try:
                yield from running.outcomes()
            finally:
                running.close()


@contextmanager
def _connected(address: str | None, jobs: int) -> Iterator[Client]:
    from distributed import Client, LocalCluster

    if address is not None:
        try:
            client = Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
        except (OSError, ValueError) as error:
            text = f"no Dask scheduler answers at {address}; start one there by `dask scheduler`"
            raise Unsuitable(f"{text} ({cause(error)})") from error
        with client:
            yield client
        return
    cluster = LocalCluster(
        n_workers=1, threads_per_worker=jobs, processes=False, memory_limit=0, dashboard_address="127.0.0.1:0"
    )
    with cluster, Client(cluster, set_as_default=False) as client:
        yield client
