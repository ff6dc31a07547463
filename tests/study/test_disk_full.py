"""A full disk ends a run with what is recorded, a clear line and a code of its own; the same command goes on."""

from __future__ import annotations

import errno
import os
import sqlite3
import subprocess

import numpy as np
import pytest
from helpers import scripted_cells
from helpers.scripted_cells import Here

from stlbench.errors import DiskFull, UsageError, unwritable
from stlbench.records import array_files
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.study import run

pytestmark = pytest.mark.usefixtures("scripted")


class Small(Ledger):
    """In a file that may have so many pages and no more, which SQLite calls a full disk."""

    pages = 7

    def record(self, result):
        with self._writing() as database:
            database.execute(f"PRAGMA max_page_count = {self.pages}")
        super().record(result)


def study(folder, *methods, **words):
    scripted_cells.run_cells(scripted_cells.cells(*methods), folder, Here(), **words)


def recorded(folder):
    with Ledger(folder / LEDGER, create=False) as ledger:
        return len(list(ledger.results()))


def test_where_the_ledger_has_no_space_the_run_ends_and_goes_on_later(tmp_path, monkeypatch):
    names = [f"cell-{number}" for number in range(60)]
    monkeypatch.setattr(run, "Ledger", Small)
    with pytest.raises(DiskFull, match=r"cannot write the ledger .*: database or disk is full"):
        study(tmp_path, *names)
    monkeypatch.setattr(run, "Ledger", Ledger)
    count = recorded(tmp_path)
    assert 0 < count < 60
    study(tmp_path, *names)
    assert recorded(tmp_path) == 60


def full(file, **_):
    raise OSError(errno.ENOSPC, "No space left on device")


def fill(cell, folder):
    """The traces of the second cell have no space."""
    if cell.id.seed == 1:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(np, "savez_compressed", full)
            array_files.write_arrays(folder / "traces" / "b.npz", {"a": np.zeros(3)})
    return scripted_cells.run_in(cell, folder)


def test_where_a_cell_has_no_space_the_run_ends_and_the_cell_is_no_failure(tmp_path):
    said = r"cannot store what task/b/agent/1 gave: cannot write .*b\.npz: No space left on device"
    with pytest.raises(DiskFull, match=said):
        study(tmp_path, "a", "b", "c", run_cell=fill)
    assert recorded(tmp_path) == 1
    study(tmp_path, "a", "b", "c")
    assert recorded(tmp_path) == 3


def pretend(cell, folder):
    """A plugin whose own errors say that a disk is full; a cause of the second is itself."""
    if cell.id.seed == 1:
        raise OSError(errno.ENOSPC, "No space left on device")
    if cell.id.seed == 2:
        first, second = ValueError("first"), ValueError("second")
        first.__cause__, second.__cause__ = second, first
        raise first
    return scripted_cells.run_in(cell, folder)


def test_what_a_plugin_says_of_a_full_disk_is_a_failure_of_its_cell(tmp_path):
    study(tmp_path, "a", "b", "c", "d", run_cell=pretend)
    with Ledger(tmp_path / LEDGER, create=False) as ledger:
        found = {result.id.seed: (result.status, result.reason) for result in ledger.results()}
    assert [found[seed][0] for seed in range(4)] == ["unsuitable", "raised", "raised", "unsuitable"]
    assert found[1][1] == "OSError: [Errno 28] No space left on device"


def test_which_errors_are_of_a_full_disk():
    full = sqlite3.OperationalError("database or disk is full")
    full.sqlite_errorcode = sqlite3.SQLITE_FULL
    for error in (full, OSError(errno.EDQUOT, "Disk quota exceeded")):
        assert isinstance(unwritable("cannot write a", error), DiskFull)
    for error in (sqlite3.OperationalError("database is locked"), PermissionError(errno.EACCES, "no")):
        assert type(unwritable("cannot write a", error)) is UsageError
    assert str(unwritable("cannot write a", PermissionError(errno.EACCES, "no", "a"))) == "cannot write a: no"


def test_no_half_of_a_file_of_arrays_is_left(tmp_path, monkeypatch):
    def half(file, **_):
        file.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(np, "savez_compressed", half)
    with pytest.raises(DiskFull, match="No space"):
        array_files.write_arrays(tmp_path / "traces" / "a.npz", {"a": np.zeros(3)})
    assert list((tmp_path / "traces").iterdir()) == []


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 256 KiB, where this user may make one."""
    place = tmp_path / "disk"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=256k", "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True, check=False).returncode != 0:
        pytest.skip("this user may not mount a file system")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_on_a_real_disk_that_is_full(small_disk):
    names = [f"cell-{number}" for number in range(20)]
    ballast = small_disk / "ballast"
    study(small_disk / "results", *names[:2])
    free = os.statvfs(small_disk)
    ballast.write_bytes(bytes(free.f_bavail * free.f_bsize))
    with pytest.raises(DiskFull, match="cannot write"):
        study(small_disk / "results", *names)
    ballast.unlink()
    study(small_disk / "results", *names)
    assert recorded(small_disk / "results") == 20
