"""One writer in a folder of results: the second is told who the first is, and a killed process holds nothing."""

from __future__ import annotations

import fcntl
import os
import signal
import subprocess
import sys
import threading

import pytest
from helpers import scripted_cells

from stlbench.errors import UsageError
from stlbench.records import upkeep
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result_files import writing
from stlbench.study.scheduler import build_executor

HOLDS = """
import sys, time
from pathlib import Path
from stlbench.records.result_files import writing
with writing(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.fixture
def held(tmp_path):
    """A folder of results and the process that writes in it."""
    folder = tmp_path / "results"
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    holder = subprocess.Popen([sys.executable, "-c", HOLDS, folder], env=environment, stdout=subprocess.PIPE, text=True)
    assert holder.stdout.readline() == "held\n"
    yield folder, holder
    holder.kill()
    holder.wait()


pytestmark = pytest.mark.usefixtures("scripted")


def study(folder, *methods, executor=None):
    place = executor or scripted_cells.Here()
    scripted_cells.run_cells(scripted_cells.cells(*methods), folder, place)


def test_a_second_run_is_told_who_writes_and_writes_nothing(held):
    folder, holder = held
    said = rf"{folder} is written by process {holder.pid} on .*, since 2.*; wait until it has ended, or take another"
    with pytest.raises(UsageError, match=said):
        study(folder, "a")
    assert [file.name for file in folder.iterdir()] == [".lock"]


def test_a_process_that_was_killed_holds_nothing(held):
    folder, holder = held
    holder.send_signal(signal.SIGKILL)
    holder.wait()
    study(folder, "a")
    with Ledger(folder / LEDGER, create=False) as ledger:
        assert len(list(ledger.results())) == 1


def test_what_a_run_has_started_does_not_hold_the_folder_when_it_has_ended(tmp_path):
    study(tmp_path, "a")
    study(tmp_path, "a", "kill", executor=build_executor(jobs=1))
    with Ledger(tmp_path / LEDGER, create=False) as ledger:
        assert [entry.status for entry in ledger.results()] == ["unsuitable", "killed"]


def test_one_who_only_looks_who_writes_keeps_nobody_from_writing(tmp_path):
    with writing(tmp_path):
        pass
    with (tmp_path / ".lock").open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_SH)
        look = threading.Timer(0.1, fcntl.flock, (file, fcntl.LOCK_UN))
        look.start()
        with writing(tmp_path):
            look.join()


def test_cells_are_not_removed_or_merged_where_another_process_writes(held, tmp_path):
    folder, _ = held
    study(tmp_path / "other", "a")
    with Ledger(folder / LEDGER) as ledger:
        ledger.record(scripted_cells.cells("a")[0].ended("unsuitable"))
    with pytest.raises(UsageError, match="is written by process"):
        upkeep.remove(folder, [scripted_cells.cells("a")[0].id])
    with pytest.raises(UsageError, match="is written by process"):
        upkeep.merge(folder, tmp_path / "other")
    assert upkeep.merge(tmp_path / "other", folder).kept == 1  # reading is free


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(UsageError, match="cannot write results in"), writing(tmp_path / "file" / "results"):
        pass
