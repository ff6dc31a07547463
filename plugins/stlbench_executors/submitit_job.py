"""A job of Slurm: a chunk of items, one after the other, each in a slot of ours.

A file is written when an item ends, so that nothing is lost of a job that is ended in the middle. A job that Slurm
starts again goes on where it was.
"""

from __future__ import annotations

import math
import os
import pickle
import signal
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from stlbench_executors.elsewhere import OFFERS, lost
from stlbench_executors.memory import share
from stlbench_executors.supervisor import Ended, Task
from stlbench_executors.worker import WorkerPool, difference, installed

SILENCE_SECONDS = 300.0
"""A job ends when the run has been silent for so long. A shared disk may show a file a minute late."""

LISTEN_SECONDS = 10.0  # between two checks of a job whether the run is there


class JobFolder(NamedTuple):
    folder: Path

    def beat(self) -> None:
        (self.folder / "beat").touch()

    def silence(self) -> float:
        """Seconds since the last beat, by the clock of the disk; infinite if the folder is gone."""
        try:
            with tempfile.NamedTemporaryFile(dir=self.folder, suffix=".now") as now:
                return os.stat(now.name).st_mtime - (self.folder / "beat").stat().st_mtime
        except FileNotFoundError:
            return math.inf

    def begin(self, index: int) -> int:
        """Note that an item begins; how often it has begun."""
        with self._begun(index).open("ab") as file:
            file.write(b".")
            return file.tell()

    def has_begun(self, index: int) -> bool:
        return self._begun(index).exists()

    def end(self, index: int, ended: Ended) -> None:
        """Record the end of an item, in a file that is there whole or not at all."""
        unfinished = self.folder / f"{index}.part"
        unfinished.write_bytes(pickle.dumps(tuple(ended)))
        unfinished.replace(self.folder / f"{index}.end")

    def has_ended(self, index: int) -> bool:
        return (self.folder / f"{index}.end").exists()

    def ended(self) -> list[int]:
        """The items whose ends can be taken, in rising order."""
        return sorted(int(Path(entry.name).stem) for entry in os.scandir(self.folder) if entry.name.endswith(".end"))

    def take(self, index: int) -> Ended:
        file = self.folder / f"{index}.end"
        ended = Ended(*pickle.loads(file.read_bytes()))  # noqa: S301 - a folder of this run, which only its user reads
        file.unlink()
        return ended

    def refuse(self, problem: str) -> None:
        (self.folder / "refused").write_text(problem)

    def refusal(self) -> str:
        file = self.folder / "refused"
        return file.read_text() if file.exists() else ""

    def _begun(self, index: int) -> Path:
        return self.folder / f"{index}.begun"


class Chunk(NamedTuple):
    job_folder: JobFolder
    tasks: tuple[tuple[int, Task], ...]  # items by their index
    memory: int | None  # bytes for an item; None for nine tenths of what the job may take
    prepare: bytes  # pickled (`Work.prepare`)
    versions: Mapping[str, str]  # of the machine that submits the jobs


def run_chunk(chunk: Chunk) -> None:
    """Run the items of a job that have not ended yet, and end the process before submitit writes a result."""
    _obey_slurm()
    threading.Thread(target=_listen, args=(chunk.job_folder,), daemon=True).start()
    _run(chunk)
    os._exit(0)


def _obey_slurm() -> None:
    """Let a cancelled job end at once, and Slurm end a late one. Submitit ignores the signals, or fails."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGUSR2, signal.SIG_IGN)


def _listen(job_folder: JobFolder) -> None:
    """End this process when the run is gone. Then its supervisors end what runs."""
    while job_folder.silence() < SILENCE_SECONDS:
        time.sleep(LISTEN_SECONDS)
    os._exit(0)


def _run(chunk: Chunk) -> None:
    if other := difference(installed(), chunk.versions):
        chunk.job_folder.refuse(f"{other}; install the same versions there")
        return
    pool = WorkerPool(chunk.memory or share(1), chunk.prepare, 1)
    try:
        for index, task in chunk.tasks:
            if not chunk.job_folder.has_ended(index):
                is_given_up = chunk.job_folder.begin(index) > OFFERS
                chunk.job_folder.end(index, lost("job") if is_given_up else pool.run(task))
    finally:
        pool.close()
