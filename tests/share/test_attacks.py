"""Bundles that somebody made to do harm: nothing of them is run, nothing is written outside, no memory is filled."""

from __future__ import annotations

import io
import sqlite3
import stat
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import bundles, line_task

from stlbench.errors import UsageError
from stlbench.records import npz, saved_policies
from stlbench.records.ledger import FILE, Ledger
from stlbench.records.outputs import cell_files
from stlbench.records.result import TASK_FOLDER
from stlbench.share import checked
from stlbench.share.checked import check, results_in, unpacked
from stlbench.share.rescored import rescore


@pytest.fixture
def bundle(site, tmp_path):
    return bundles.packed(site, tmp_path)[0]


def test_code_that_a_ledger_names_is_not_run(bundle, tmp_path) -> None:
    """A ledger may say in which folder a task is, and to load that task runs what is there."""
    evil = tmp_path / "zz-evil"
    evil.mkdir()
    (evil / "task.yaml").write_text(line_task.text())
    (evil / "system.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n{line_task.SYSTEM}")
    (result,) = bundles.results_of(bundle)
    with Ledger(tmp_path / FILE) as ledger:
        moved = replace(result.id, task=replace(result.id.task, name="zz-evil"))
        ledger.record(replace(result, id=moved, provenance={TASK_FOLDER: str(evil)}))
    with sqlite3.connect(tmp_path / FILE) as database:
        database.execute("PRAGMA journal_mode=DELETE")
    database.close()
    path = bundles.told(bundle, tmp_path / "evil.zip", {FILE: (tmp_path / FILE).read_bytes()})
    assert check(path).problems == (f"{FILE}: no file of a bundle",)
    with unpacked(path) as (folder, _):
        assert [found.id.task.name for found in results_in(folder)] == ["zz-line"]
    with pytest.raises(UsageError, match="no file of a bundle"):
        list(rescore(path))
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize("name", ["system.py", "policies/a.py", "policies/deep/a.npz", "traces", "x/cells.jsonl", FILE])
def test_only_files_of_a_bundle_are_unpacked(bundle, tmp_path, name) -> None:
    path = bundles.told(bundle, tmp_path / "more.zip", {name: b"1"})
    with unpacked(path) as (folder, problems):
        assert problems == (f"{name}: no file of a bundle",)
        assert not (folder / name).is_file()


def test_a_link_is_a_file_with_a_path_in_it(bundle, tmp_path) -> None:
    secret = tmp_path / "secret.md"
    secret.write_text("nobody's business")
    path = bundles.told(bundle, tmp_path / "link.zip", {"link.md": str(secret).encode()})
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(tmp_path / "linked.zip", "w") as copy:
        for info in source.infolist():
            if info.filename == "link.md":
                info.external_attr = (stat.S_IFLNK | 0o777) << 16
            copy.writestr(info, source.read(info.filename))
    with unpacked(tmp_path / "linked.zip") as (folder, problems):
        assert problems == ()
        assert not (folder / "link.md").is_symlink()
        assert (folder / "link.md").read_text() == str(secret)


def bomb(size: int) -> bytes:
    """An .npz with an array of zeros, a thousandth as long as what it becomes."""
    file = io.BytesIO()
    np.savez_compressed(file, **{"selected/action": np.zeros(size, np.uint8), "final/action": np.array(1)})
    return file.getvalue()


def test_policies_that_would_fill_the_memory_are_not_read(bundle, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(checked, "LARGEST_POLICIES", 2**20)
    monkeypatch.setattr(npz, "read", lambda *_: pytest.fail("it was read"))
    with zipfile.ZipFile(bundle) as archive:
        policy = next(name for name in archive.namelist() if name.startswith("policies/"))
    path = bundles.told(bundle, tmp_path / "bomb.zip", {policy: bomb(2**22)})
    assert path.stat().st_size < 2**15
    assert check(path).problems == ("zz-line/raw/zz-kept/0: its policies would be more than 1 MiB in memory",)


def test_a_bundle_that_would_fill_the_disk_is_not_unpacked(bundle, tmp_path, monkeypatch) -> None:
    path = bundles.told(bundle, tmp_path / "bomb.zip", {"zeros.csv": bytes(2**22)})
    assert check(path).problems == ()
    monkeypatch.setattr(checked, "LARGEST", 2**20)
    with pytest.raises(UsageError, match="more than 1 MiB unpacked"):
        check(path)


def test_a_list_of_files_that_is_endless_is_not_read(bundle, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(checked, "_LIST", 1000)
    with pytest.raises(UsageError, match="its list of files is"):
        check(bundle)


def test_a_key_that_is_a_path_is_none(bundle, tmp_path) -> None:
    outside = cell_files(Path("x"), bundles.results_of(bundle)[0].id, "/../../out").policies
    assert ".." in str(outside)  # what a key would reach
    path = bundles.claiming(bundle, tmp_path / "key.zip", lambda result: replace(result, key="/../../out"))
    assert check(path).problems == ("zz-line/raw/zz-kept/0: its key is none",)


@pytest.mark.parametrize("line", [b"[" * 100_000, b'{"task": ' * 50_000, b"\xff\xfe", b"\x00"])
def test_a_line_that_no_reader_can_take_is_one_line(bundle, tmp_path, line) -> None:
    (said,) = check(bundles.told(bundle, tmp_path / "deep.zip", {"cells.jsonl": line})).problems
    assert "cells.jsonl" in said
    assert len(said.splitlines()) == 1


def test_names_that_steer_a_terminal_are_shown_as_text(bundle, tmp_path) -> None:
    path = bundles.changed(bundle, tmp_path / "colour.zip", {"\x1b[2J\u202egnp.exe": b"1"})
    (said,) = check(path).problems
    assert said.isprintable()


def other_policy(action: int) -> tuple[bytes, str]:
    """The file of a policy that always takes this action, and its hash."""
    arrays = {"action": np.array(action)}
    file = io.BytesIO()
    np.savez_compressed(file, **{"selected/action": arrays["action"]})
    return file.getvalue(), saved_policies.digest(arrays)


def test_a_worse_policy_under_the_numbers_of_a_better_one_is_found(bundle, tmp_path) -> None:
    data, digest = other_policy(2)
    with zipfile.ZipFile(bundle) as archive:
        policy = next(name for name in archive.namelist() if name.startswith("policies/"))

    def swapped(result):
        measured = result.measurement
        policies = replace(measured.policies, selected=digest, final=digest)
        return replace(result, measurement=replace(measured, policies=policies))

    path = bundles.claiming(bundles.told(bundle, tmp_path / "1.zip", {policy: data}), tmp_path / "2.zip", swapped)
    assert check(path).problems == ()
    (found,) = rescore(path)
    assert found.verdict == "claims more"
