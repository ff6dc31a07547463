"""The server of a pool: a fresh interpreter that imports everything once, and forks a supervisor for each slot."""

from __future__ import annotations

import gc
import os
import pickle
import signal
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from types import ModuleType
from typing import Any

import psutil

from stlbench_executors.item_process import adopt, end_strays
from stlbench_executors.supervisor import supervise

if not hasattr(signal, "pthread_sigmask"):
    raise ImportError("stopping workers needs POSIX signals: Linux, macOS, or WSL on Windows")

ONE_THREAD = {"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
"""Read when numpy or torch is imported, so a server must be born with them."""


class Server(SpawnProcess):
    """A fresh interpreter, which does not run the user's script again. It forks a supervisor for each link."""

    def __init__(self, links: Sequence[Connection], limit: int, prepare: bytes) -> None:
        super().__init__(target=_serve, args=(links, limit, prepare))

    def start(self) -> None:
        with _environment(ONE_THREAD), _blocked_interrupts():
            super().start()

    @staticmethod
    def _Popen(process: Any) -> Any:  # noqa: N802 - the name is that of multiprocessing
        script = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            return SpawnProcess._Popen(process)
        finally:
            sys.modules["__main__"] = script


def _serve(links: Sequence[Connection], limit: int, prepare: bytes) -> None:
    os.setsid()  # a ctrl-C in the terminal is for the harness
    adopt()
    with suppress(BaseException):
        pickle.loads(prepare)()  # noqa: S301 - from our own parent
    if psutil.Process().num_threads() > 1:
        os._exit(1)  # a fork would copy locks that no thread releases; the next server prepares nothing
    gc.collect()
    gc.freeze()  # memory that no garbage collection visits stays shared with all forks
    supervisors = {_forked(link, links, limit) for link in links}
    for link in links:
        link.close()
    while supervisors:
        supervisors.discard(os.wait()[0])
        end_strays(supervisors)


def _forked(own: Connection, links: Sequence[Connection], limit: int) -> int:
    """The process number of a supervisor. In its own process this never returns."""
    process = os.fork()
    if process:
        return process
    try:
        for link in links:
            if link is not own:
                link.close()
        supervise(own, limit)
    finally:
        os._exit(0)


@contextmanager
def _environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Set variables for the processes that start meanwhile; numpy is imported here already and does not look."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _blocked_interrupts() -> Iterator[None]:
    """Processes that start meanwhile never receive a ctrl-C, not even while Python starts up."""
    resource_tracker.ensure_running()  # when a process start begins it, it unblocks the signals
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
