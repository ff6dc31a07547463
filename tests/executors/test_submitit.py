"""Cells as jobs: by submitit's own executor on this machine, and on a Slurm whose commands are scripts of the test."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest
from executors.test_local import alive
from helpers import fake_slurm, victims
from helpers.waiting import wait_for

from stlbench.contract import Outcome, Unsuitable, Work
from stlbench.testing import Rules, check_executor

pytest.importorskip("submitit", reason="the extra submitit is not installed")

from stlbench_executors.submitit import SubmititExecutor
from stlbench_executors.submitit_job import SILENCE_SECONDS, JobFolder
from stlbench_executors.submitit_run import minutes_for

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def soon(monkeypatch: pytest.MonkeyPatch) -> None:
    """States are asked for at once, and a disk shows what was written."""
    monkeypatch.setattr("stlbench_executors.submitit_run.STATE_SECONDS", 0.2)
    monkeypatch.setattr("stlbench_executors.submitit_run.LAG_SECONDS", 0.2)


@pytest.fixture
def slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of a Slurm that is on the PATH."""
    commands = fake_slurm.install(tmp_path / "slurm")
    monkeypatch.setenv("PATH", f"{commands}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    return tmp_path / "slurm"


def executor(tmp_path: Path, **options: object) -> SubmititExecutor:
    return SubmititExecutor(folder=str(tmp_path / "jobs"), **options)


def outcomes(made: SubmititExecutor, function, items, deadline: float = 600.0) -> dict[int, Outcome]:
    found = list(made.run(function, items, [deadline] * len(items)))
    assert sorted(outcome.index for outcome in found) == list(range(len(items)))
    return {outcome.index: outcome for outcome in found}


def test_it_keeps_the_rules_of_executors(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))

    class Here(SubmititExecutor):
        def __init__(self, *, jobs: int) -> None:
            super().__init__(jobs=jobs, cluster="local", cells_per_job=8, folder=str(tmp_path / "jobs"))

    rules = Rules()
    check_executor(Here, rules)
    assert rules.kept[-1] == "closing the iterator stops what runs"
    assert not (tmp_path / "jobs").exists()


def test_it_says_where_an_item_ran_however_that_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    made = executor(tmp_path, jobs=1, cluster="local", cells_per_job=3)
    found = outcomes(made, Work(victims.work, facts=victims.where), ["a", "raise b", "exit 3"])
    assert [found[index].status for index in range(3)] == ["done", "raised", "killed"]
    assert str(os.getpid()) not in {found[index].facts["process"] for index in range(3)}


def test_an_array_of_slurm_says_what_the_user_wants(slurm: Path, tmp_path: Path) -> None:
    made = executor(tmp_path, jobs=3, cells_per_job=2, memory=2**30, partition="short", account="me")
    items = ["a", "raise no such luck", "b", "kill 9", "c"]
    found = outcomes(made, victims.work, items)
    assert [found[index].status for index in range(5)] == ["done", "raised", "done", "killed", "done"]
    assert [found[index].value for index in (0, 2, 4)] == ["A", "B", "C"]
    (script,) = (file.read_text() for file in slurm.glob("*.script"))
    for option in ("array=0-2%3", "partition=short", "account=me", "mem=2048M", "cpus-per-task=1"):
        assert f"#SBATCH --{option}\n" in script
    assert int(re.findall(r"--time=(\d+)", script)[0]) == minutes_for([600.0] * 2) == 23
    assert not (tmp_path / "jobs").exists()


def write_state(slurm: Path, process: int, state: str) -> None:
    """End the job above a process, as Slurm would."""
    (file,) = (file for file in slurm.glob("*.pid") if os.getsid(process) and _is_below(process, int(file.read_text())))
    file.with_suffix(".state").write_text(state)
    fake_slurm.end(file)


def _is_below(process: int, job: int) -> bool:
    import psutil

    return job in {parent.pid for parent in psutil.Process(process).parents()}


@pytest.mark.parametrize(
    ("state", "found"),
    [
        ("NODE_FAIL", ("done", "later", "")),
        ("TIMEOUT", ("timeout", None, r"its job \d+ ended before it: TIMEOUT")),
        ("OUT_OF_MEMORY", ("killed", None, r"its job \d+ ended before it: OUT_OF_MEMORY")),
    ],
)
def test_what_slurm_says_of_a_job_that_it_ended(slurm: Path, tmp_path: Path, state: str, found: tuple) -> None:
    (tmp_path / "there").touch()
    items = [tmp_path / name for name in ("there", "stays", "there")]
    status, value, reason = found
    with closing(executor(tmp_path, cells_per_job=3).run(victims.stay_once, items, [600.0] * 3)) as running:
        assert next(running).value == "later"  # written before the job was lost
        wait_for(lambda: items[1].exists() and items[1].read_text())
        process = int(items[1].read_text())
        write_state(slurm, process, state)
        others = {outcome.index: outcome for outcome in running}
    assert (others[1].status, others[1].value) == (status, value)
    assert re.fullmatch(reason, others[1].reason)
    assert others[2].value == "later"  # in another job
    assert not alive(process)


@pytest.mark.parametrize(
    ("accounts", "begun", "found"),
    [
        (False, True, ("done", "later", "")),
        (False, False, ("killed", None, r"its job \d+ ended before it: CANCELLED")),
        (True, True, ("killed", None, r"its job \d+ ended before it: FAILED")),
    ],
)
def test_a_job_that_squeue_has_forgotten(
    slurm: Path, tmp_path: Path, accounts: bool, begun: bool, found: tuple
) -> None:
    """Accounts know it. Without any, a job whose items have begun was lost; else a person cancelled it in the queue."""
    if accounts:
        (slurm / "accounts").touch()
    items = [tmp_path / "there", tmp_path / "stays"]
    items[0].touch()
    with closing(executor(tmp_path, cells_per_job=2).run(victims.stay_once, items, [600.0] * 2)) as running:
        assert next(running).value == "later"
        wait_for(lambda: items[1].exists() and items[1].read_text())
        (file,) = slurm.glob("*.pid")
        if not begun:
            (mark,) = tmp_path.glob("jobs/*/ended/1.begun")
            mark.unlink()
        file.with_suffix(".forgotten").touch()
        write_state(slurm, int(items[1].read_text()), "FAILED")
        (outcome,) = running
    assert (outcome.status, outcome.value) == found[:2]
    assert re.fullmatch(found[2], outcome.reason)


def test_silence_is_measured_by_the_clock_of_the_disk(tmp_path: Path) -> None:
    desk = JobFolder(tmp_path)
    desk.beat()
    assert 0 <= desk.silence() < SILENCE_SECONDS
    then = (tmp_path / "beat").stat().st_mtime - 1000
    os.utime(tmp_path / "beat", (then, then))
    assert desk.silence() >= 1000
    assert JobFolder(tmp_path / "gone").silence() == float("inf")


def test_a_job_ends_when_its_run_is_gone(tmp_path: Path) -> None:
    """The process of an item is ended too: its supervisor sees that the job's process has ended."""
    program = (
        "import sys\nfrom pathlib import Path\nfrom helpers import victims\n"
        "from stlbench_executors import submitit_job\nfrom stlbench_executors.worker import WorkItems\n"
        "from stlbench_executors.worker import installed\n"
        "submitit_job.LISTEN_SECONDS = 0.1\n"
        "order = WorkItems(victims.leave_pid, [Path(sys.argv[1], 'a')], [600.0])\n"
        "desk = submitit_job.JobFolder(Path(sys.argv[1], 'desk'))\n"
        "submitit_job.run_chunk(submitit_job.Chunk(desk, ((0, order.task(0)),), 2**30, order.prepare, installed()))\n"
    )
    desk, file = JobFolder(tmp_path / "desk"), tmp_path / "a"
    desk.folder.mkdir()
    desk.beat()
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    job = subprocess.Popen([sys.executable, "-c", program, tmp_path], env=environment)
    wait_for(lambda: file.exists() and file.read_text())
    assert job.poll() is None
    then = (desk.folder / "beat").stat().st_mtime - SILENCE_SECONDS - 1
    os.utime(desk.folder / "beat", (then, then))
    job.wait(timeout=120)
    wait_for(lambda: not alive(int(file.read_text())))


def test_closing_cancels_jobs(slurm: Path, tmp_path: Path) -> None:
    items = [None, tmp_path / "a"]
    with closing(executor(tmp_path).run(victims.leave_pid, items, [600.0] * 2)) as running:
        assert next(running).index == 0
        wait_for(lambda: items[1].exists() and items[1].read_text())
    assert {file.read_text() for file in slurm.glob("*.state")} == {"CANCELLED by 1000"}
    wait_for(lambda: not alive(int(items[1].read_text())))


def test_a_job_that_cannot_start_ends_the_run_with_what_it_said(
    slurm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "submitit.py").write_text("raise SystemExit('no such module here')\n")
    monkeypatch.setenv("PYTHONPATH", str(broken))
    with pytest.raises(
        Unsuitable, match=r"job 100 ended as COMPLETED before its first item began: .*no such module here"
    ):
        outcomes(executor(tmp_path), victims.work, ["a"])


def test_a_job_with_another_plugin_is_refused(slurm: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "site" / "more_methods-1.2.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: more-methods\nVersion: 1.2\n")
    (info / "entry_points.txt").write_text("[stlbench.methods]\nmore = more_methods:More\n")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(tmp_path / "site"), *sys.path]))
    with pytest.raises(Unsuitable, match=r"more-methods is 1\.2 there, and here not installed"):
        outcomes(executor(tmp_path), victims.work, ["a"])


def test_without_slurm_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    with pytest.raises(Unsuitable, match="needs Slurm, and here is no sbatch or srun; cluster=local goes without"):
        SubmititExecutor()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_no_job_outlives_an_interrupted_parent(tmp_path: Path, number: signal.Signals) -> None:
    program = (
        "import signal, sys\nfrom pathlib import Path\nfrom helpers import victims\n"
        "from stlbench_executors.submitit import SubmititExecutor\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "made = SubmititExecutor(cluster='local', folder=sys.argv[1] + '/jobs')\n"
        "list(made.run(victims.leave_pid, [Path(sys.argv[1], 'a')], [600.0]))\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    parent = subprocess.Popen([sys.executable, "-c", program, tmp_path], env=environment, stderr=subprocess.PIPE)
    file = tmp_path / "a"
    wait_for(lambda: file.exists() and file.read_text())
    parent.send_signal(number)
    parent.communicate(timeout=120)
    wait_for(lambda: not alive(int(file.read_text())))
    wait_for(lambda: not (tmp_path / "jobs").exists())
