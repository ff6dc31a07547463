"""Cells as jobs of a real Slurm without accounts, and what becomes of them when jobs, nodes or the run are lost."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from executors.test_local import alive
from helpers import victims
from helpers.waiting import wait_for
from long import slurm_cluster

from stlbench_executors.submitit import SubmititExecutor

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(not slurm_cluster.is_possible(), reason="needs root, and Debian's slurm-wlm and munge"),
]


@pytest.fixture
def cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[slurm_cluster.Cluster]:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    with slurm_cluster.cluster(tmp_path / "slurm") as made:
        yield made


def executor(tmp_path: Path, **options: object) -> SubmititExecutor:
    return SubmititExecutor(folder=str(tmp_path / "jobs"), **options)


def test_jobs_whose_items_ended_are_completed(cluster: slurm_cluster.Cluster, tmp_path: Path) -> None:
    items = ["a", "raise b", "c", "kill 9", "d"]
    made = executor(tmp_path, cells_per_job=2)
    found = {outcome.index: outcome for outcome in made.run(victims.work, items, [600.0] * 5)}
    assert [found[index].status for index in range(5)] == ["done", "raised", "done", "killed", "done"]
    wait_for(lambda: set(cluster.states().values()) == {"COMPLETED"})
    assert len(cluster.states()) == 3


def test_a_job_of_an_array_that_a_person_cancels_while_it_waits(cluster: slurm_cluster.Cluster, tmp_path: Path) -> None:
    items = [None, tmp_path / "a", tmp_path / "b"]
    with closing(executor(tmp_path, jobs=1).run(victims.leave_pid, items, [600.0] * 3)) as running:
        assert next(running).index == 0
        (array,) = {job.partition("_")[0] for job in cluster.states()}
        subprocess.run(["scancel", f"{array}_2"], check=True)
        outcome = next(running)
        assert (outcome.index, outcome.status) == (2, "killed")
        assert outcome.reason == f"its job {array}_2 ended before it: CANCELLED"


@pytest.mark.parametrize("told", [True, False], ids=["told", "silent"])
@pytest.mark.parametrize("requeue", [True, False], ids=["requeued", "not requeued"])
def test_an_item_whose_node_is_lost_runs_on_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, requeue: bool, told: bool
) -> None:
    """The node ends silently, or an administrator says that it is down."""
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    (tmp_path / "there").touch()
    items = [tmp_path / "there", tmp_path / "stays"]
    with (
        slurm_cluster.cluster(tmp_path / "slurm", requeue=requeue) as cluster,
        closing(executor(tmp_path, cells_per_job=2).run(victims.stay_once, items, [600.0] * 2)) as running,
    ):
        assert next(running).value == "later"
        wait_for(lambda: items[1].exists() and items[1].read_text())
        (job,) = cluster.states()
        node = cluster.node_of(job)
        if told:
            subprocess.run(["scontrol", "update", f"NodeName={node}", "State=DOWN", "Reason=test"], check=True)
        else:
            cluster.lose(node)
        outcome = next(running)
        assert (outcome.index, outcome.status, outcome.value, outcome.reason) == (1, "done", "later", "")


def test_a_job_that_takes_too_long_for_slurm(cluster: slurm_cluster.Cluster, tmp_path: Path) -> None:
    items = [None, tmp_path / "a"]
    with closing(executor(tmp_path).run(victims.leave_pid, items, [600.0] * 2)) as running:
        assert next(running).index == 0
        (job,) = (job for job in cluster.states() if job.endswith("_1"))
        wait_for(lambda: items[1].exists() and items[1].read_text())
        subprocess.run(["scontrol", "update", f"JobId={job}", "TimeLimit=1"], check=True)
        outcome = next(running)
        assert (outcome.status, outcome.reason) == ("timeout", f"its job {job} ended before it: TIMEOUT")


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_no_job_outlives_the_run(cluster: slurm_cluster.Cluster, tmp_path: Path, number: signal.Signals) -> None:
    """What is killed cannot cancel its jobs: they end when they have heard nothing of it for five minutes."""
    program = (
        "import sys\nfrom pathlib import Path\nfrom helpers import victims\n"
        "from stlbench_executors.submitit import SubmititExecutor\n"
        "made = SubmititExecutor(folder=sys.argv[1] + '/jobs', jobs=1)\n"
        "list(made.run(victims.leave_pid, [Path(sys.argv[1], name) for name in 'ab'], [3600.0] * 2))\n"
    )
    file = tmp_path / "a"
    with subprocess.Popen([sys.executable, "-c", program, tmp_path]) as run:
        wait_for(lambda: file.exists() and file.read_text())
        run.send_signal(number)
    assert run.returncode == (128 + number if number != signal.SIGKILL else -number)
    seconds = 60 if number != signal.SIGKILL else 500
    wait_for(lambda: not {"RUNNING", "PENDING"} & set(cluster.states().values()), seconds)
    wait_for(lambda: not alive(int(file.read_text())))
