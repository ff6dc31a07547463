"""Workers that raise, hang and die, for real."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import victims
from helpers.waiting import wait_for

from stlbench.contract import Outcome
from stlbench_executors.local import LocalExecutor


def outcomes(function, items, jobs=1, deadline=60.0) -> dict[int, Outcome]:
    found = list(LocalExecutor(jobs=jobs).run(function, items, [deadline] * len(items)))
    assert sorted(outcome.index for outcome in found) == list(range(len(items)))
    return {outcome.index: outcome for outcome in found}


def alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().split()[2] != "Z"
    except (FileNotFoundError, ProcessLookupError):  # the latter where it ends between opening and reading
        return False


def test_each_item_ends_in_its_own_way_and_the_others_are_done():
    items = [
        "a",
        "raise no such luck",
        "b",
        "kill 9",
        "hang",
        "exit 3",
        "kill 15",
        "kill 11",
        "leave now",
        "raise",
        "c",
    ]
    found = outcomes(victims.work, items, jobs=2, deadline=3.0)
    assert [found[index].value for index in (0, 2, 10)] == ["A", "B", "C"]
    assert [(found[index].status, found[index].reason) for index in (1, *range(3, 10))] == [
        ("raised", "ValueError: no such luck"),
        ("killed", "killed by signal 9 (SIGKILL)"),
        ("timeout", "no result after 3 s"),
        ("killed", "the process ended with exit code 3"),
        ("killed", "killed by signal 15 (SIGTERM)"),
        ("killed", "killed by signal 11 (SIGSEGV)"),
        ("raised", "SystemExit: now"),
        ("raised", "ValueError"),
    ]
    assert "raise ValueError(rest)" in found[1].details


def test_many_deaths_in_a_row_lose_nothing():
    items = [item for number in range(6) for item in (f"x{number}", "kill 9")]
    found = outcomes(victims.work, items)
    assert [found[index].status for index in range(12)] == ["done", "killed"] * 6


def test_code_that_no_python_signal_handler_interrupts_is_stopped_at_its_deadline():
    found = outcomes(victims.spin, ["spin", "a"], deadline=1.0)
    assert (found[0].status, found[1].value) == ("timeout", "a")


def test_each_item_has_its_own_deadline():
    found = {o.index: o.reason for o in LocalExecutor(jobs=2).run(victims.work, ["hang", "hang"], [0.5, 1.5])}
    assert found == {0: "no result after 0.5 s", 1: "no result after 1.5 s"}


def test_each_item_has_a_process_of_its_own_below_as_many_supervisors_as_jobs():
    assert len({outcome.value for outcome in outcomes(victims.pid, range(5)).values()}) == 5
    assert len({outcome.value for outcome in outcomes(victims.slow_parent, range(6), jobs=2).values()}) == 2
    assert outcomes(victims.pid, [0])[0].value != os.getpid()


def test_an_idle_supervisor_that_is_killed_is_replaced():
    running = LocalExecutor(jobs=1).run(victims.slow_parent, range(2), [60.0, 60.0])
    first = next(running).value
    os.kill(first, signal.SIGKILL)
    wait_for(lambda: not alive(first))
    second = next(running)
    assert second.status == "done"
    assert second.value != first


def test_a_worker_has_one_thread_for_linear_algebra_and_the_parent_keeps_its_own(monkeypatch):
    names = ["OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS"]
    monkeypatch.setenv(names[0], "7")
    monkeypatch.delenv(names[1], raising=False)
    assert [outcome.value for outcome in outcomes(victims.environment, names).values()] == ["1", "1", "1"]
    assert os.environ[names[0]] == "7"
    assert names[1] not in os.environ


def test_no_worker_sees_an_interrupt_and_the_parent_does():
    found = outcomes(victims.interrupted, ["kill 9", "masked"])
    assert found[1].value == "masked"
    assert signal.SIGINT not in signal.pthread_sigmask(signal.SIG_BLOCK, ())


@pytest.mark.parametrize(
    ("function", "reason"),
    [(victims.closure, "local object 'closure.<locals>.<lambda>'"), (victims.unreadable, "cannot be rebuilt")],
)
def test_what_cannot_be_sent_back_is_told(function, reason):
    found = outcomes(function, [0, 0])
    assert [outcome.status for outcome in found.values()] == ["raised", "raised"]
    assert reason in found[0].reason


PROGRAM = """
import signal, sys
from pathlib import Path
from helpers import victims
from helpers.waiting import wait_for
from stlbench_executors.local import LocalExecutor
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background has it ignored
folder = Path(sys.argv[1])
for outcome in LocalExecutor(jobs=2).run(victims.leave_pid, [folder / "a", folder / "b"], [600.0, 600.0]):
    print(outcome)
"""


def test_a_script_needs_no_guard_against_being_run_again_by_its_workers(tmp_path):
    program = tmp_path / "program.py"
    program.write_text(
        "from helpers import victims\n"
        "from stlbench_executors.local import LocalExecutor\n"
        "print('read once')\n"
        "print([outcome.value for outcome in LocalExecutor(jobs=1).run(victims.work, ['a', 'b'], [60.0, 60.0])])\n"
    )
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    ran = subprocess.run([sys.executable, program], env=environment, capture_output=True, text=True)
    assert (ran.returncode, ran.stdout) == (0, "read once\n['A', 'B']\n"), ran.stderr


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, -signal.SIGINT), (signal.SIGKILL, -signal.SIGKILL)])
def test_no_worker_outlives_a_parent_that_is_interrupted_or_killed(tmp_path, sent, code):
    program = tmp_path / "program.py"
    program.write_text(PROGRAM)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, program, tmp_path]
    parent = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True)
    files = [tmp_path / "a", tmp_path / "b"]
    wait_for(lambda: all(file.exists() and file.read_text() for file in files))
    workers = [int(file.read_text()) for file in files]
    assert all(map(alive, workers))
    if sent == signal.SIGINT:
        os.killpg(parent.pid, sent)  # as the terminal does: to all processes of the group
    else:
        parent.kill()
    _, errors = parent.communicate(timeout=60)
    assert parent.returncode == code
    wait_for(lambda: not any(map(alive, workers)))
    assert errors.count("Traceback") <= 1, "only the parent's own KeyboardInterrupt"


UNABLE = """
from stlbench_executors import local, pool
from helpers import victims
from helpers.waiting import wait_for
pool.START_SECONDS = {seconds}
for outcome in local.LocalExecutor(jobs=2).run(victims.pid, [0, 1, 2], [600.0] * 3):
    print(outcome.index, outcome.status, outcome.reason)
"""

AT_A_WORKERS_START = """
import os, sys, time
if "--multiprocessing-fork" in sys.orig_argv:
    {start}
"""


@pytest.mark.parametrize(("start", "seconds"), [("os._exit(1)", 600.0), ("time.sleep(600)", 0.5)])
def test_workers_that_cannot_start_are_told_and_nothing_waits_for_ever(tmp_path, start, seconds):
    program = tmp_path / "program.py"
    program.write_text(UNABLE.format(seconds=seconds))
    (tmp_path / "sitecustomize.py").write_text(AT_A_WORKERS_START.format(start=start))
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
    command = [sys.executable, program]
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=True)
    reason = "killed 3 worker processes, one after the other, ended or hung before they took it"
    assert sorted(ended.stdout.splitlines()) == [f"{index} {reason}" for index in range(3)]


def test_nothing_to_do_starts_nothing():
    assert list(LocalExecutor(jobs=2).run(victims.work, [], [])) == []


@pytest.mark.parametrize("deadlines", [[0.0], [-1.0], []])
def test_a_deadline_is_required(deadlines):
    with pytest.raises(ValueError, match="deadline"):
        next(LocalExecutor().run(victims.work, ["a"], deadlines))


def test_without_posix_signals_it_says_what_it_needs():
    program = "import signal; del signal.pthread_sigmask\nfrom stlbench.registry import plugins\n"
    program += "plugins.find('executors', 'local').load()"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert "ImportError: stopping workers needs POSIX signals: Linux, macOS, or WSL" in ran.stderr.splitlines()[-1]
    assert "executor 'local' of stlbench-rl" in ran.stderr.splitlines()[-1]
