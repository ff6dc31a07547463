"""A Dask scheduler and workers on this machine, each started by its own command, as on a cluster."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cached_property
from pathlib import Path

import psutil

from helpers.waiting import wait_for

WORKER = ("--nthreads", "1", "--no-nanny", "--memory-limit", "0", "--no-dashboard")


class Cluster:
    """The processes, and where they write."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.workers = folder, list[subprocess.Popen[bytes]]()
        self.file = folder / "scheduler.json"
        self.scheduler = self._start("scheduler", "--port", "0", "--no-dashboard", "--scheduler-file", str(self.file))

    @cached_property
    def address(self) -> str:
        """Of the scheduler, which takes a while to have one."""
        wait_for(self._said)
        return self._said()

    def _said(self) -> str:
        """The scheduler's address, empty where it has not written it yet."""
        with suppress(OSError, ValueError):
            return str(json.loads(self.file.read_text())["address"])
        return ""

    def add_worker(self, *options: str, **environment: str) -> subprocess.Popen[bytes]:
        """Start one, with one thread where nothing else is said."""
        started = self._start("worker", self.address, *(options or WORKER), environment=environment)
        self.workers.append(started)
        return started

    def worker_of(self, process: int) -> subprocess.Popen[bytes]:
        """The worker above a process."""
        above = {parent.pid for parent in psutil.Process(process).parents()}
        return next(worker for worker in self.workers if worker.pid in above)

    def _start(self, kind: str, *words: str, environment: Mapping[str, str] | None = None) -> subprocess.Popen[bytes]:
        """It imports what the tests do, from an empty folder."""
        home = self.folder / f"{kind}-{len(self.workers)}"
        home.mkdir()
        known = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)} | dict(environment or {})
        with (self.folder / f"{home.name}.log").open("wb") as log:
            command = [sys.executable, "-m", "dask", kind, *words]
            return subprocess.Popen(command, cwd=home, env=known, stdout=log, stderr=subprocess.STDOUT)

    def close(self) -> None:
        for process in (*self.workers, self.scheduler):
            process.kill()
            process.wait()


@contextmanager
def cluster(folder: Path, workers: int) -> Iterator[Cluster]:
    """A scheduler and so many workers, which end with the block."""
    folder.mkdir(parents=True, exist_ok=True)
    made = Cluster(folder)
    try:
        for _ in range(workers):
            made.add_worker()
        yield made
    finally:
        made.close()
