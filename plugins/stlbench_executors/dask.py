"""Workers of a Dask scheduler. Dask moves items there and outcomes back; all else is done as by `local`.

Dask repeats the task of a worker that died up to three times, knows no deadline, and lets tasks wait at a worker. So
each item is sent to one worker that has a free place, and a supervisor there runs it (`dask_run`).
"""

from __future__ import annotations

import re
import uuid
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field

from stlbench.contract import Executor, Outcome, Unsuitable, cause
from stlbench_executors.memory import Memory
from stlbench_executors.worker import WorkItems, installed

if TYPE_CHECKING:
    from distributed import Client

CONNECT_SECONDS = 20.0
_ADDRESS = re.compile(r"inproc://.+|\w+://.+:\d+")
"""Dask refuses other addresses only after it has waited, and with a traceback."""


class DaskExecutor(Executor):
    """Workers of a Dask scheduler, on any number of machines: each thread of a worker runs one item at a time.

    Each item has a process of its own on its worker, with its deadline and its memory, as with `local`. An item whose
    worker is lost is offered to another one, once. Traces, policies and logs are written by the workers: the folder of
    results has to be on a disk that all share.

    Args:
        jobs: items at a time; where it is None, as many as the workers have threads.
        memory: bytes for one item; where it is None, its share of nine tenths of what its worker may take.
        address: of the scheduler, as in tcp://node1:8786. Without one, a scheduler and a worker are made for the run in
            this process.
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
        from stlbench_executors.dask_run import DaskRun, Run

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
