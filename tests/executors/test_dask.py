"""Cells on workers of a Dask scheduler: as on this machine, and with workers that are lost in the middle."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from itertools import islice
from pathlib import Path

import pytest
from executors.test_local import alive
from helpers import victims
from helpers.waiting import wait_for

from stlbench.contract import Outcome, Unsuitable, Work
from stlbench.registry.choices import parse_choices
from stlbench.study.plan import plan_cells
from stlbench.study.results import Results
from stlbench.study.run import run_cells
from stlbench.testing import Rules, check_executor
from stlbench_executors.local import LocalExecutor

pytest.importorskip("distributed", reason="the extra dask is not installed")

from helpers.dask_cluster import Cluster, cluster

from stlbench_executors.dask import DaskExecutor

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore:waiting for a worker"),  # on a machine that does much else
]


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """A scheduler and two workers, which no test ends."""
    with cluster(tmp_path_factory.mktemp("cluster"), workers=2) as made:
        yield made


def outcomes(address: str | None, function, items, deadline: float = 600.0) -> dict[int, Outcome]:
    found = list(DaskExecutor(jobs=2, address=address).run(function, items, [deadline] * len(items)))
    assert sorted(outcome.index for outcome in found) == list(range(len(items)))
    return {outcome.index: outcome for outcome in found}


def test_it_keeps_the_rules_of_executors_without_a_cluster() -> None:
    rules = Rules()
    check_executor(DaskExecutor, rules)
    assert rules.kept[-1] == "closing the iterator stops what runs"


@pytest.mark.slow
def test_it_keeps_them_on_a_cluster(two: Cluster) -> None:
    class OnCluster(DaskExecutor):
        def __init__(self, *, jobs: int) -> None:
            super().__init__(jobs=jobs, address=two.address)

    check_executor(OnCluster)


def test_all_workers_are_used_where_no_number_of_jobs_is_said(two: Cluster, tmp_path: Path) -> None:
    (tmp_path / "2").mkdir()
    items = [str(tmp_path / "2" / name) for name in "ab"]
    found = DaskExecutor(address=two.address).run(victims.meet, items, [600.0] * 2)
    assert {outcome.value for outcome in found} == {"a", "b"}


def test_what_an_item_writes_is_in_its_log_and_what_it_takes_is_limited(two: Cluster, tmp_path: Path) -> None:
    work = Work(victims.say, log=partial(victims.log, tmp_path))
    outcomes(two.address, work, ["print one", "silent"])
    assert {path.name: path.read_text() for path in (tmp_path / "logs").iterdir()} == {"print.log": "caf\\udce9 one\n"}
    (found,) = DaskExecutor(address=two.address, memory=300 * 2**20).run(victims.eat, ["400"], [600.0])
    assert (found.status, found.reason[:8]) == ("killed", "it took ")


def test_it_says_where_an_item_ran_however_that_ended(two: Cluster) -> None:
    found = outcomes(two.address, Work(victims.work, facts=victims.where), ["a", "raise b", "exit 3", "hang"], 5.0)
    assert [found[index].status for index in range(4)] == ["done", "raised", "killed", "timeout"]
    said = {found[index].facts["process"] for index in range(4)}
    assert said
    assert str(os.getpid()) not in said


@pytest.mark.slow
def test_a_cell_has_the_same_bits_as_on_this_machine(two: Cluster, tmp_path: Path) -> None:
    cells = plan_cells(parse_choices("integrator-or"), parse_choices("raw,funnel"), None, [0], "smoke")
    found = []
    for name, executor in ("here", LocalExecutor(jobs=1)), ("there", DaskExecutor(address=two.address)):
        run_cells(cells, tmp_path / name, executor)
        results = Results.load(tmp_path / name)
        scores = [(result.status, result.measurement.selected, result.measurement.final) for result in results]
        found.append((scores, [results.traces(result.id).samples.tobytes() for result in results]))
        assert [result.status for result in results] == ["done", "done"]
    assert found[0] == found[1]


@pytest.mark.slow
def test_an_item_whose_worker_is_lost_is_offered_once_more_and_the_others_go_on(tmp_path: Path) -> None:
    (tmp_path / "there").write_text("")
    items = [tmp_path / name for name in ("there", "lost", "there", "there")]
    with cluster(tmp_path / "cluster", workers=2) as made:
        with closing(DaskExecutor(address=made.address).run(victims.stay_once, items, [600.0] * 4)) as running:
            found = {outcome.index: outcome for outcome in islice(running, 3)}
            wait_for(lambda: items[1].exists() and items[1].read_text())
            process = int(items[1].read_text())
            made.worker_of(process).kill()
            found |= {outcome.index: outcome for outcome in running}
        assert [found[index].value for index in range(4)] == ["later"] * 4
        assert not alive(process)


def test_an_item_whose_workers_are_lost_twice_is_killed(tmp_path: Path) -> None:
    with cluster(tmp_path / "cluster", workers=2) as made:
        ended = list[Outcome]()
        run = DaskExecutor(address=made.address).run(victims.leave_pid, [tmp_path / "a"], [600.0])
        thread = threading.Thread(target=lambda: ended.extend(run))
        thread.start()
        for _ in range(2):
            wait_for(lambda: (tmp_path / "a").exists() and (tmp_path / "a").read_text())
            worker = made.worker_of(int((tmp_path / "a").read_text()))
            (tmp_path / "a").unlink()
            worker.kill()
        thread.join(120)
    (outcome,) = ended
    assert (outcome.status, outcome.reason) == ("killed", "the worker that ran it was lost, 2 times")


PROGRAM = """
import signal, sys
from pathlib import Path
from helpers import victims
from helpers.waiting import wait_for
from stlbench_executors.dask import DaskExecutor
signal.signal(signal.SIGINT, signal.default_int_handler)
items = [Path(sys.argv[2]) / name for name in "abcd"]
for outcome in DaskExecutor(address=sys.argv[1]).run(victims.leave_pid, items, [600.0] * 4):
    print(outcome)
"""


@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGKILL])
def test_where_the_parent_ends_what_runs_ends_and_what_is_queued_does_not_begin(
    two: Cluster, tmp_path: Path, sent: signal.Signals
) -> None:
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, "-c", PROGRAM, two.address, str(tmp_path)]
    parent = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    files = [tmp_path / name for name in "ab"]
    wait_for(lambda: all(file.exists() and file.read_text() for file in files))
    parent.send_signal(sent)
    assert parent.communicate(timeout=120)[0] == b""
    wait_for(lambda: not any(alive(int(file.read_text())) for file in files))
    assert not (tmp_path / "c").exists()
    assert outcomes(two.address, victims.work, ["a"])[0].value == "A"
    assert not (tmp_path / "c").exists()


def test_a_scheduler_that_ends_is_told_and_nothing_goes_on(tmp_path: Path) -> None:
    with cluster(tmp_path / "cluster", workers=2) as made:
        items = [None, tmp_path / "a"]
        with closing(DaskExecutor(address=made.address).run(victims.leave_pid, items, [600.0] * 2)) as run:
            assert next(run).status == "done"
            wait_for(lambda: (tmp_path / "a").exists() and (tmp_path / "a").read_text())
            made.scheduler.kill()
            with pytest.raises(Unsuitable, match="the Dask scheduler does not answer any more; what ended before is"):
                next(run)
        wait_for(lambda: not alive(int((tmp_path / "a").read_text())))


@pytest.mark.parametrize(
    ("entry", "version", "said"),
    [
        ("stlbench.methods", "1.2", "more-methods is 1.2 there, and here not installed; install the same versions"),
        ("console_scripts", "1.2", ""),
    ],
)
def test_a_worker_with_another_plugin_is_refused(tmp_path: Path, entry: str, version: str, said: str) -> None:
    info = tmp_path / "site" / f"more_methods-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: more-methods\nVersion: {version}\n")
    (info / "entry_points.txt").write_text(f"[{entry}]\nmore = more_methods:More\n")
    with cluster(tmp_path / "cluster", workers=0) as made:
        made.add_worker(PYTHONPATH=os.pathsep.join([str(tmp_path / "site"), *sys.path]))
        if said:
            with pytest.raises(Unsuitable, match=rf"worker tcp://\S+ cannot be used: {said}"):
                outcomes(made.address, victims.work, ["a"])
        else:
            assert outcomes(made.address, victims.work, ["a"])[0].value == "A"


def test_a_worker_below_a_nanny_that_forbids_processes_is_refused(tmp_path: Path) -> None:
    with cluster(tmp_path / "cluster", workers=0) as made:
        made.add_worker("--nthreads", "1", "--no-dashboard")
        with pytest.raises(Unsuitable, match=r"its nanny lets it start no processes; start it with --no-nanny"):
            outcomes(made.address, victims.work, ["a"])


@pytest.mark.parametrize("address", ["foo", "tcp://foo", "node1:8786", ""])
def test_an_address_without_a_port_is_refused_at_once(address: str) -> None:
    with pytest.raises(Unsuitable, match=r"^executor dask: the address of a scheduler is like tcp://node1:8786, got "):
        DaskExecutor(address=address)


def test_where_no_scheduler_answers_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stlbench_executors.dask.CONNECT_SECONDS", 0.5)
    with pytest.raises(Unsuitable, match=r"^no Dask scheduler answers at tcp://127.0.0.1:9; start one there by `dask"):
        list(DaskExecutor(address="tcp://127.0.0.1:9").run(victims.work, ["a"], [60.0]))


def test_a_user_without_workers_is_told_and_the_first_that_comes_is_used(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("stlbench_executors.dask.WARN_SECONDS", 0.1)
    with cluster(tmp_path / "cluster", workers=0) as made:
        threading.Timer(3.0, made.add_worker).start()
        with pytest.warns(UserWarning, match=rf"waiting for a worker; one is started by `dask worker {made.address} "):
            assert outcomes(made.address, victims.work, ["a"])[0].value == "A"
