"""What happens in a job of Slurm: a chunk of items, one after the other, each in a slot of ours.

How each ended is a file, written when it ends, so that nothing is lost of a job that is ended in the middle. A job that
Slurm starts again goes on where it was.
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

from stlbench_executors.keeper import Ended, Task
from stlbench_executors.memory import share
from stlbench_executors.worker import Crew, difference, installed

OFFERS = 2
"""So often an item is begun, where the job before was lost."""

SILENCE_SECONDS = 300.0
"""A job ends when the run has not said for so long that it is there. A shared disk may show a file a minute late."""

LISTEN_SECONDS = 10.0
"""How often a job looks whether the run is there."""


class Desk(NamedTuple):
    """The folder over which a run and its jobs tell each other what has happened."""

    folder: Path

    def beat(self) -> None:
        """The run is there."""
        (self.folder / "beat").touch()

    def silence(self) -> float:
        """Seconds since the last beat; infinite where the folder is gone.

        Both times are those of the disk, so that the clocks of two machines need not agree.
        """
        try:
            with tempfile.NamedTemporaryFile(dir=self.folder, suffix=".now") as now:
                return os.stat(now.name).st_mtime - (self.folder / "beat").stat().st_mtime
        except FileNotFoundError:
            return math.inf

    def begin(self, index: int) -> int:
        """An item begins; how often it has."""
        with self._begun(index).open("ab") as file:
            file.write(b".")
            return file.tell()

    def has_begun(self, index: int) -> bool:
        """A job has begun an item."""
        return self._begun(index).exists()

    def end(self, index: int, ended: Ended) -> None:
        """An item has ended. The file is there whole, or not at all."""
        unfinished = self.folder / f"{index}.part"
        unfinished.write_bytes(pickle.dumps(tuple(ended)))
        unfinished.replace(self.folder / f"{index}.end")

    def has_ended(self, index: int) -> bool:
        """How an item ended is there to be taken."""
        return (self.folder / f"{index}.end").exists()

    def ended(self) -> list[int]:
        """Items of which that is so, in their order."""
        return sorted(int(Path(entry.name).stem) for entry in os.scandir(self.folder) if entry.name.endswith(".end"))

    def take(self, index: int) -> Ended:
        """How an item ended; the file is no longer there then."""
        file = self.folder / f"{index}.end"
        ended = Ended(*pickle.loads(file.read_bytes()))  # noqa: S301 - a folder of this run, which only its user reads
        file.unlink()
        return ended

    def refuse(self, problem: str) -> None:
        """A job cannot run the items of this run."""
        (self.folder / "refused").write_text(problem)

    def refusal(self) -> str:
        """Why; empty where none has."""
        file = self.folder / "refused"
        return file.read_text() if file.exists() else ""

    def _begun(self, index: int) -> Path:
        return self.folder / f"{index}.begun"


class Chunk(NamedTuple):
    """What a job is given."""

    desk: Desk
    tasks: tuple[tuple[int, Task], ...]
    """Which items, and what their keepers are given."""
    memory: int | None
    """Bytes for an item; None for nine tenths of what the job may take."""
    prepare: bytes
    """Pickled (`Work.prepare`)."""
    versions: Mapping[str, str]
    """Of where the items come from."""


def run_chunk(chunk: Chunk) -> None:
    """Run the items of a job that have not ended yet. The process ends with it, unless an item cannot be run.

    Submitit would write a result into the folder, which the run takes away as soon as it has all items: a job that did
    its work would be FAILED.
    """
    _obey_slurm()
    threading.Thread(target=_listen, args=(chunk.desk,), daemon=True).start()
    _run(chunk)
    os._exit(0)


def _obey_slurm() -> None:
    """A job that is cancelled ends at once. One that takes too long is ended by Slurm, as TIMEOUT.

    Submitit ignores the first signal, and makes a failure of the second, which announces the end of the walltime.
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGUSR2, signal.SIG_IGN)


def _listen(desk: Desk) -> None:
    """End this process when the run is gone. Its keepers end what runs, as they do when it is killed."""
    while desk.silence() < SILENCE_SECONDS:
        time.sleep(LISTEN_SECONDS)
    os._exit(0)


def _run(chunk: Chunk) -> None:
    if other := difference(installed(), chunk.versions):
        chunk.desk.refuse(f"{other}; install the same versions there")
        return
    crew = Crew(chunk.memory or share(1), chunk.prepare, 1)
    try:
        for index, task in chunk.tasks:
            if not chunk.desk.has_ended(index):
                chunk.desk.end(index, _ended(crew, chunk.desk.begin(index), task))
    finally:
        crew.close()


def _ended(crew: Crew, times: int, task: Task) -> Ended:
    return lost() if times > OFFERS else crew.run(task)


def lost() -> Ended:
    """Of an item that is not begun again."""
    return Ended("killed", reason=f"the job that ran it was lost, {OFFERS} times")
