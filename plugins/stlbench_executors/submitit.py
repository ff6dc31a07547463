"""Jobs of Slurm, submitted as arrays by submitit: some items each, one after the other.

Submitit sees to files of jobs, arrays and states. The supervisor in the job ends an item, as with `local`; the walltime
of a job matters only if the supervisor is gone.
"""

from __future__ import annotations

import shutil
import uuid
from collections.abc import Callable, Collection, Generator, Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from pydantic import Field

from stlbench.contract import Executor, Outcome, Unsuitable, cause
from stlbench_executors.memory import Memory
from stlbench_executors.submitit_job import Chunk, JobFolder, run_chunk
from stlbench_executors.submitit_run import SubmititRun, beating, ended_by_signals, minutes_for, states
from stlbench_executors.worker import WorkItems, installed

if TYPE_CHECKING:
    from submitit import Job
    from submitit import LocalExecutor as Jobs
    from submitit import SlurmExecutor as SlurmJobs

ARRAY = 1000  # jobs of an array, at most; Slurm's own limit is 1001 by default
JOB_NAME = "stlbench"  # of every job, as `squeue` shows it
AT_A_TIME = 256  # jobs that run at the same time by default, as submitit has it
OVERHEAD = 2**30  # bytes of a job for the process that has everything imported, and for the supervisor


class SubmititExecutor(Executor):
    """Jobs of Slurm: `cells_per_job` items each, one after the other.

    Each item has a process of its own in its job, with its deadline and its memory, as with `local`. A job's walltime
    is the sum of the deadlines of its items, and what it takes to start and end them. An item whose job was lost with
    its node is offered once more. The folder of results and that of jobs have to be on a disk that all nodes share.

    Args:
        jobs: jobs that run at a time, Slurm's limit of the array; 256 where it is None.
        memory: bytes for one item, for which a job asks and 1 GiB more; where it is None, Slurm's default for the job,
            of which an item may take nine tenths.
        cells_per_job: items of a job; many where items are short, as a job takes seconds to start.
        partition: of Slurm.
        account: of Slurm.
        qos: quality of service, of Slurm.
        constraint: features of nodes, of Slurm.
        folder: where files of jobs are while a run goes on.
        cluster: slurm, or local for jobs on this machine, two at a time where `jobs` is None: to try it.
    """

    def __init__(
        self,
        *,
        jobs: Annotated[int, Field(ge=1)] | None = None,
        memory: Memory | None = None,
        cells_per_job: Annotated[int, Field(ge=1)] = 1,
        partition: str | None = None,
        account: str | None = None,
        qos: str | None = None,
        constraint: str | None = None,
        folder: str = "submitit",
        cluster: Literal["slurm", "local"] = "slurm",
    ) -> None:
        if find_spec("submitit") is None:
            raise Unsuitable('executor submitit needs submitit: pip install "stlbench-rl[submitit]"')
        if cluster == "slurm" and not (shutil.which("sbatch") and shutil.which("srun")):
            raise Unsuitable("executor submitit needs Slurm, and here is no sbatch or srun; cluster=local goes without")
        super().__init__(jobs=jobs or (AT_A_TIME if cluster == "slurm" else 2))
        self.memory, self.size, self.cluster, self.folder = memory, cells_per_job, cluster, Path(folder)
        choice = {"partition": partition, "account": account, "qos": qos, "constraint": constraint}
        self._slurm = {name: value for name, value in choice.items() if value is not None}

    def run(
        self, function: Callable[[Any], Any], items: Sequence[Any], deadlines: Sequence[float]
    ) -> Generator[Outcome]:
        work, folder = WorkItems(function, items, deadlines), (self.folder / uuid.uuid4().hex[:12]).absolute()
        if len(work) == 0:
            return
        job_folder, versions = JobFolder(folder / "ended"), installed()

        def submit(jobs: Sequence[Sequence[int]]) -> Sequence[Job[Any]]:
            tasks = (tuple((index, work.task(index)) for index in indices) for indices in jobs)
            chunks = [Chunk(job_folder, each, self.memory, work.prepare, versions) for each in tasks]
            deadlines = max(([task.deadline for _, task in chunk.tasks] for chunk in chunks), key=sum)
            try:
                return self._submitter(folder, deadlines).map_array(run_chunk, chunks)
            except Exception as error:
                raise Unsuitable(f"jobs cannot be submitted: {cause(error)}") from error

        queued = ARRAY if self.cluster == "slurm" else self.jobs
        running = SubmititRun(work, job_folder, submit, self._states, self.size, self.jobs, queued)
        with ended_by_signals():
            try:
                job_folder.folder.mkdir(parents=True, mode=0o700)
                with beating(job_folder):
                    yield from running.outcomes()
            finally:
                self._cancel(folder, running.jobs)
                shutil.rmtree(folder, ignore_errors=True)
                with suppress(OSError):
                    self.folder.rmdir()  # where no other run is

    def _submitter(self, folder: Path, deadlines: Sequence[float]) -> Jobs | SlurmJobs:
        import submitit

        if self.cluster == "local":
            jobs = submitit.LocalExecutor(folder)
            jobs.update_parameters(timeout_min=minutes_for(deadlines))
            return jobs
        memory = {} if self.memory is None else {"mem": f"{(self.memory + OVERHEAD) // 2**20}M"}
        slurm = submitit.SlurmExecutor(folder)
        slurm.update_parameters(
            job_name=JOB_NAME,
            time=minutes_for(deadlines),
            cpus_per_task=1,
            array_parallelism=self.jobs,
            **memory,
            **self._slurm,
        )
        return slurm

    def _states(self, jobs: Collection[Job[Any]]) -> Mapping[str, str]:
        if self.cluster == "local":
            return {job.job_id: job.state.upper() for job in jobs}
        return states([job.job_id for job in jobs], JOB_NAME)

    def _cancel(self, folder: Path, jobs: Collection[Job[Any]]) -> None:
        from submitit import SlurmJob

        if self.cluster == "local":
            for job in jobs:
                job.cancel(check=False)
        for array in {job.job_id.partition("_")[0] for job in jobs} if self.cluster == "slurm" else ():
            SlurmJob[Any](folder, array).cancel(check=False)
