"""A run on Slurm: the states of its jobs, and the loop that submits chunks of items and collects outcomes.

`squeue` knows each job until some minutes after its end (`MinJobAge` of the cluster). `sacct` knows it for ever, but
only where the cluster keeps accounts. So `squeue` is asked first.
"""

from __future__ import annotations

import getpass
import math
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

from stlbench.contract import Unsuitable
from stlbench_executors.elsewhere import OFFERS, RunElsewhere
from stlbench_executors.pool import GRACE_SECONDS, START_SECONDS
from stlbench_executors.submitit_job import JobFolder
from stlbench_executors.supervisor import Ended
from stlbench_executors.worker import WorkItems

if TYPE_CHECKING:
    from submitit import Job

GONE = "GONE"  # our name for the state of a job that neither `squeue` nor `sacct` knows

LOST = ("NODE_FAIL", "BOOT_FAIL", "PREEMPTED", "REVOKED", "INTERRUPTED", GONE)
"""States of jobs that ended through no fault of theirs. INTERRUPTED comes from submitit's jobs on this machine."""

LATE = ("TIMEOUT", "DEADLINE")  # states of jobs that took too long

OVER = (*LOST, *LATE, "CANCELLED", "COMPLETED", "FAILED", "OUT_OF_MEMORY", "FINISHED")
"""States of jobs that have ended. In every other state a job waits, runs, or will run again by itself."""

_ANSWER_SECONDS = 60.0


def states(jobs: Collection[str], name: str) -> dict[str, str]:
    """The state of each job, such as "17" or "17_3": "RUNNING", or `GONE` if unknown. Empty if Slurm is silent."""
    lines = _ask("squeue", "--noheader", "--array", "--states=all", f"--user={getpass.getuser()}", f"--name={name}",
                 "--format=%i|%T")  # fmt: skip
    if lines is None:
        return {}
    states = _parsed(lines)
    if missing := [job for job in jobs if job not in states]:
        arrays = ",".join(sorted({job.partition("_")[0] for job in missing}))
        states |= _parsed(
            _ask("sacct", "--noheader", "--array", "--allocations", "--parsable2", "--format=JobID,State", "-j", arrays)
            or []
        )
    return {job: states.get(job, GONE) for job in jobs}


def _parsed(lines: list[str]) -> dict[str, str]:
    """Number -> state; of "CANCELLED by 1000" the first word."""
    pairs = (line.partition("|") for line in lines)
    return {job: state.split()[0].rstrip("+") for job, _, state in pairs if state.split()}


def _ask(*command: str) -> list[str] | None:
    try:
        done = subprocess.run(  # noqa: S603 - our own words, and the numbers of our jobs
            command, capture_output=True, text=True, timeout=_ANSWER_SECONDS, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.splitlines()


CHECK_SECONDS = 0.5  # between two checks for items that have ended
STATE_SECONDS = 10.0  # between two queries of the states of jobs
BEAT_SECONDS = 10.0  # between two signs of life for the jobs
LAG_SECONDS = 15.0  # a shared disk may show the files of a job so long after its end
STARTS = 5  # jobs that are submitted for an item which none of them has begun


def minutes_for(deadlines: Sequence[float]) -> int:
    """The walltime of a job for items with these deadlines, in seconds: with what it takes to start and to end them."""
    return math.ceil((START_SECONDS + sum(deadline + GRACE_SECONDS for deadline in deadlines)) / 60)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into `SystemExit`, so that jobs are cancelled. Only the main thread can do so."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def leave(number: int, _: FrameType | None) -> NoReturn:
        raise SystemExit(128 + number)

    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    ours = [number for number, handler in before.items() if handler is signal.SIG_DFL]
    for number in ours:
        signal.signal(number, leave)
    try:
        yield
    finally:
        for number in ours:
            signal.signal(number, signal.SIG_DFL)


@contextmanager
def beating(job_folder: JobFolder) -> Iterator[None]:
    """Show the jobs all the time that the run is there, however long the caller takes for an outcome."""
    over = threading.Event()

    def beat() -> None:
        while not over.wait(BEAT_SECONDS):
            with suppress(OSError):
                job_folder.beat()

    job_folder.beat()
    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


class SubmititRun(RunElsewhere):
    """Items that jobs have.

    Args:
        items: the items.
        job_folder: where jobs say how items ended.
        submit: submits jobs, each given by the indices of its items, as one array.
        states: the states of jobs by their numbers, as far as they are known.
        size: items of a job.
        most: jobs at a time.
        queued: jobs of an array, at most.
    """

    def __init__(
        self,
        items: WorkItems,
        job_folder: JobFolder,
        submit: Callable[[Sequence[Sequence[int]]], Sequence[Job[Any]]],
        states: Callable[[Collection[Job[Any]]], Mapping[str, str]],
        size: int,
        most: int,
        queued: int,
    ) -> None:
        super().__init__(items)
        self._job_folder, self._submit, self._states = job_folder, submit, states
        self._size, self._most, self._queued = size, most, queued
        self._jobs: dict[Job[Any], list[int]] = {}
        self._ended: dict[Job[Any], float] = {}
        self._next_states = 0.0

    def _turn(self) -> None:
        self._send()
        self._collect()
        if time.monotonic() >= self._next_states:
            self._check()
            self._next_states = time.monotonic() + min(STATE_SECONDS, LAG_SECONDS)

    def _wait(self) -> None:
        time.sleep(CHECK_SECONDS)

    @property
    def jobs(self) -> Collection[Job[Any]]:
        """Those with items that have not ended."""
        return self._jobs.keys()

    def _send(self) -> None:
        """An array, as long as the last one was; a small one only where that fills a good part of the places."""
        free = self._queued if not self._jobs else self._most - len(self._jobs)
        if not self._waiting or (self._jobs and free < max(1, self._most // 4)):
            return
        chunks = list[list[int]]()
        while self._waiting and len(chunks) < free:
            chunks.append([self._waiting.popleft() for _ in range(min(self._size, len(self._waiting)))])
        for index in (index for chunk in chunks for index in chunk):
            self._offers[index] += 1
        jobs = self._submit(chunks)
        self._jobs |= dict(zip(jobs, chunks, strict=True))

    def _collect(self) -> None:
        if problem := self._job_folder.refusal():
            raise Unsuitable(f"jobs cannot run items of this run: {problem}")
        ended = self._job_folder.ended()
        for index in ended:
            self._end(index, self._job_folder.take(index))
        if ended:
            self._jobs = {job: indices for job, indices in self._jobs.items() if not self._left.isdisjoint(indices)}

    def _check(self) -> None:
        """Find jobs that have ended without the ends of all their items."""
        now, known = time.monotonic(), self._states(self._jobs)
        over = {job: known[job.job_id] for job in self._jobs if known.get(job.job_id) in OVER}
        # a job that has ended may wait or run the next time, since Slurm restarts some
        self._ended = {job: self._ended.get(job, now) for job in over}
        for job, state in over.items():
            if now - self._ended[job] >= LAG_SECONDS:
                indices = [index for index in self._jobs.pop(job) if index in self._left]
                for index in indices:
                    self._settle(index, job, state)

    def _settle(self, index: int, job: Job[Any], state: str) -> None:
        """Submit an item again, or record its end, after its job has ended before it."""
        begun = self._job_folder.has_begun(index)
        if state == GONE and not begun:
            state = "CANCELLED"  # `squeue` forgets at once a job of an array that is cancelled while it waits
        if state in LOST or (not begun and state in (*LATE, "OUT_OF_MEMORY")):
            self._lose(index, "job", OFFERS if begun else STARTS)
        elif begun or state == "CANCELLED" or len(self._left) < len(self._items):
            reason = f"its job {job.job_id} ended before it: {state}"
            self._end(index, Ended("timeout" if state in LATE else "killed", reason=reason))
        else:
            raise Unsuitable(f"job {job.job_id} ended as {state} before its first item began: {_last_words(job)}")


def _last_words(job: Job[Any]) -> str:
    lines = (job.stderr() or "").strip().splitlines()
    return lines[-1] if lines else f"it wrote nothing to {job.paths.stderr}"
