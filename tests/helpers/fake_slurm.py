"""A Slurm of this machine: sbatch, srun, sacct, squeue and scancel for one test, each as a script on the PATH.

Of an array all jobs run at once. A job's state is what the file of its name says, else what its process does, so that a
test writes `NODE_FAIL` there and kills the process. It keeps accounts where the folder has the file `accounts`; a job
with a file `.forgotten` is unknown to `squeue`.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

COMMANDS = ("sbatch", "srun", "sacct", "squeue", "scancel")


def install(folder: Path) -> Path:
    """Write the commands; the folder to put first on the PATH."""
    commands = folder / "bin"
    commands.mkdir(parents=True)
    for name in COMMANDS:
        script = commands / name
        script.write_text(f'#!/bin/sh\nFAKE_SLURM="{folder}" exec {sys.executable} {__file__} {name} "$@"\n')
        script.chmod(0o755)
    return commands


def sbatch(folder: Path, script: str) -> None:
    text, number = Path(script).read_text(), 100 + len(list(folder.glob("*.script")))
    (folder / f"{number}.script").write_text(text)
    array = re.search(r"--array=0-(\d+)", text)
    for place in range(int(array[1]) + 1) if array else [None]:
        name = str(number) if place is None else f"{number}_{place}"
        known = {"SLURM_JOB_ID": str(number), "SLURM_JOB_NODELIST": "node1", "SLURM_NTASKS": "1"}
        if place is not None:
            known |= {"SLURM_ARRAY_JOB_ID": str(number), "SLURM_ARRAY_TASK_ID": str(place)}
        output = (folder / f"{name}.out").open("wb")
        job = subprocess.Popen(
            ["bash", script], env=os.environ | known, stdout=output, stderr=output, start_new_session=True
        )
        (folder / f"{name}.pid").write_text(str(job.pid))
    print(f"Submitted batch job {number}")


def srun(_: Path, *words: str) -> None:
    """What is left when its own options are taken away, of which the one for errors is obeyed."""
    rest = list(words)
    while rest[0].startswith("--"):
        name, value = rest[:2]
        if name == "--error":
            os.dup2(os.open(_path(value), os.O_WRONLY | os.O_CREAT | os.O_APPEND), 2)
        del rest[: 2 if name in ("--error", "--output") else 1]
    os.execvp(rest[0], rest)


def _path(pattern: str) -> str:
    known = {"%j": "SLURM_JOB_ID", "%A": "SLURM_ARRAY_JOB_ID", "%a": "SLURM_ARRAY_TASK_ID"}
    return re.sub("%[jAat]", lambda found: os.environ[known[found[0]]] if found[0] in known else "0", pattern)


def squeue(folder: Path, *_: str) -> None:
    for file in sorted(folder.glob("*.pid")):
        if not file.with_suffix(".forgotten").exists():
            print(f"{file.stem}|{state(file).split()[0]}")


def sacct(folder: Path, *_: str) -> None:
    if not (folder / "accounts").exists():
        sys.exit("Slurm accounting storage is disabled")
    for file in sorted(folder.glob("*.pid")):
        print(f"{file.stem}|{state(file)}")


def scancel(folder: Path, number: str, *_: str) -> None:
    for file in [*folder.glob(f"{number}.pid"), *folder.glob(f"{number}_*.pid")]:
        file.with_suffix(".state").write_text("CANCELLED by 1000")
        end(file)


def end(file: Path) -> None:
    """Kill a job with all its processes, as Slurm does."""
    with suppress(ProcessLookupError):
        os.killpg(int(file.read_text()), signal.SIGKILL)


def state(file: Path) -> str:
    said = file.with_suffix(".state")
    if said.exists():
        return said.read_text()
    return "RUNNING" if _is_alive(int(file.read_text())) else "COMPLETED"


def _is_alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except OSError:
        return False


if __name__ == "__main__":
    globals()[sys.argv[1]](Path(os.environ["FAKE_SLURM"]), *sys.argv[2:])
