"""The states of jobs, as Slurm tells them.

`squeue` knows each job until some minutes after its end (`MinJobAge` of the cluster). `sacct` knows it for ever, but
only where the cluster keeps accounts. So `squeue` is asked first. Submitit asks `sacct` alone, and takes an array task
that was cancelled while it waited for one that still waits.
"""

from __future__ import annotations

import getpass
import subprocess
from collections.abc import Collection

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
