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
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from types import FrameType
from typing import TYPE_CHECKING, Any, NoReturn

from stlbench.contract import Outcome, Unsuitable
from stlbench_executors.keeper import Ended
from stlbench_executors.slot import GRACE_SECONDS, START_SECONDS
from stlbench_executors.submitit_job import OFFERS, Chunk, Desk, lost
from stlbench_executors.worker import Order, outcome_of

if TYPE_CHECKING:
    from submitit import Job

GONE = "GONE"
"""Our word for a job that neither `squeue` nor `sacct` knows."""

LOST = ("NODE_FAIL", "BOOT_FAIL", "PREEMPTED", "REVOKED", "INTERRUPTED", GONE)
"""The job did nothing wrong. INTERRUPTED is a state of submitit's own jobs on this machine."""

LATE = ("TIMEOUT", "DEADLINE")
"""The job took too long."""

OVER = (*LOST, *LATE, "CANCELLED", "COMPLETED", "FAILED", "OUT_OF_MEMORY", "FINISHED")
"""The job has ended. In every other state it waits, runs, or will run again by itself."""

_ANSWER_SECONDS = 60.0


def states(jobs: Collection[str], name: str) -> dict[str, str]:
    """The state of each job, such as "RUNNING"; `GONE` for one that Slurm does not know.

    Empty where Slurm does not answer: nothing is known then.

    Args:
        jobs: the numbers, such as "17" or "17_3" of an array.
        name: the name that all of them have.
    """
    lines = _ask("squeue", "--noheader", "--array", "--states=all", f"--user={getpass.getuser()}", f"--name={name}",
                 "--format=%i|%T")  # fmt: skip
    if lines is None:
        return {}
    found = _parsed(lines)
    if missing := [job for job in jobs if job not in found]:
        arrays = ",".join(sorted({job.partition("_")[0] for job in missing}))
        found |= _parsed(
            _ask("sacct", "--noheader", "--array", "--allocations", "--parsable2", "--format=JobID,State", "-j", arrays)
            or []
        )
    return {job: found.get(job, GONE) for job in jobs}


def _parsed(lines: list[str]) -> dict[str, str]:
    """Number -> state; of "CANCELLED by 1000" the first word."""
    pairs = (line.partition("|") for line in lines)
    return {job: state.split()[0].rstrip("+") for job, _, state in pairs if state.split()}


def _ask(*command: str) -> list[str] | None:
    """The lines of the answer; None where there is none."""
    try:
        done = subprocess.run(  # noqa: S603 - our own words, and the numbers of our jobs
            command, capture_output=True, text=True, timeout=_ANSWER_SECONDS, check=True
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return done.stdout.splitlines()


LOOK_SECONDS = 0.5
"""How often it is looked at what has ended."""

STATE_SECONDS = 10.0
"""How often the states of jobs are asked for."""

BEAT_SECONDS = 10.0
"""How often the run tells its jobs that it is there."""

LAG_SECONDS = 15.0
"""So much later than the end of a job a shared disk may show what it wrote."""

STARTS = 5
"""In so many jobs an item is that no job has begun."""


def minutes_for(deadlines: Sequence[float]) -> int:
    """The walltime of a job for items with these deadlines, in seconds: with what it takes to start and to end them."""
    return math.ceil((START_SECONDS + sum(deadline + GRACE_SECONDS for deadline in deadlines)) / 60)


@contextmanager
def ended_by_signals() -> Iterator[None]:
    """End in order, so that jobs are cancelled, where this process is told to end or its terminal is closed.

    Only the main thread can say so; elsewhere nothing changes.
    """
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
def beating(desk: Desk) -> Iterator[None]:
    """Tell the jobs all the time that the run is there, however long the caller takes for an outcome."""
    over = threading.Event()

    def beat() -> None:
        while not over.wait(BEAT_SECONDS):
            with suppress(OSError):
                desk.beat()

    desk.beat()
    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


class SubmititRun:
    """What is to be run, the jobs there are, and what has ended.

    Args:
        order: the items.
        desk: where jobs say how items ended.
        chunk: makes what a job is given of the numbers of its items.
        submit: submits such chunks, as one array.
        states: the state of each job by its number (`slurm_states`), of those of which anything is known.
        size: items of a job.
        most: jobs at a time.
        queued: jobs of an array, at most.
    """

    def __init__(
        self,
        order: Order,
        desk: Desk,
        chunk: Callable[[Sequence[int]], Chunk],
        submit: Callable[[Sequence[Chunk]], Sequence[Job[Any]]],
        states: Callable[[Collection[Job[Any]]], Mapping[str, str]],
        size: int,
        most: int,
        queued: int,
    ) -> None:
        self._order, self._desk, self._chunk, self._submit = order, desk, chunk, submit
        self._states = states
        self._size, self._most, self._queued = size, most, queued
        self._waiting, self._left = deque(range(len(order))), set(range(len(order)))
        self._offers = [0] * len(order)
        self._jobs: dict[Job[Any], list[int]] = {}
        self._ended: dict[Job[Any], float] = {}
        self._next_states, self._over = 0.0, deque[Outcome]()

    def outcomes(self) -> Generator[Outcome]:
        """One for each item, as they end. Raises `Unsuitable` where jobs cannot run them."""
        while self._left:
            self._send()
            self._collect()
            if time.monotonic() >= self._next_states:
                self._look()
                self._next_states = time.monotonic() + min(STATE_SECONDS, LAG_SECONDS)
            yield from self._told()
            if self._left:
                time.sleep(LOOK_SECONDS)

    def _told(self) -> Generator[Outcome]:
        while self._over:
            yield self._over.popleft()

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
        jobs = self._submit([self._chunk(indices) for indices in chunks])
        self._jobs |= dict(zip(jobs, chunks, strict=True))

    def _collect(self) -> None:
        if problem := self._desk.refusal():
            raise Unsuitable(f"jobs cannot run items of this run: {problem}")
        ended = self._desk.ended()
        for index in ended:
            said = self._desk.take(index)
            self._end(index, said)
        if ended:
            self._jobs = {job: indices for job, indices in self._jobs.items() if not self._left.isdisjoint(indices)}

    def _end(self, index: int, said: Ended) -> None:
        if index in self._left:  # else of a job that was thought lost
            self._left.remove(index)
            self._over.append(outcome_of(index, said))

    def _look(self) -> None:
        """Jobs that are over, with items of which nothing has come for a while."""
        now, known = time.monotonic(), self._states(self._jobs)
        over = {job: known[job.job_id] for job in self._jobs if known.get(job.job_id) in OVER}
        # Slurm starts some jobs again by itself, so that one that was over may wait or run the next time
        self._ended = {job: self._ended.get(job, now) for job in over}
        for job, state in over.items():
            if now - self._ended[job] >= LAG_SECONDS:
                indices = [index for index in self._jobs.pop(job) if index in self._left]
                for index in indices:
                    self._settle(index, job, state)

    def _settle(self, index: int, job: Job[Any], state: str) -> None:
        """What becomes of an item whose job has ended before it did."""
        begun = self._desk.has_begun(index)
        if state == GONE and not begun:
            state = "CANCELLED"  # `squeue` forgets at once a job of an array that is cancelled while it waits
        if state in LOST or (not begun and state in (*LATE, "OUT_OF_MEMORY")):
            if self._offers[index] < (OFFERS if begun else STARTS):
                self._waiting.appendleft(index)
            else:
                self._end(index, lost())
        elif begun or state == "CANCELLED" or len(self._left) < len(self._order):
            reason = f"its job {job.job_id} ended before it: {state}"
            self._end(index, Ended("timeout" if state in LATE else "killed", reason=reason))
        else:
            raise Unsuitable(f"job {job.job_id} ended as {state} before its first item began: {_last_words(job)}")


def _last_words(job: Job[Any]) -> str:
    lines = (job.stderr() or "").strip().splitlines()
    return lines[-1] if lines else f"it wrote nothing to {job.paths.stderr}"
