"""Bundles that somebody changed, by accident or to do harm: what is wrong is named, and nothing else happens."""

from __future__ import annotations

import errno
import io
import stat
import zipfile
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import bundles, line_task
from helpers.ledgers import say

from stlbench.errors import DiskFull, UsageError
from stlbench.records import array_files
from stlbench.records.ledger import LEDGER, Ledger
from stlbench.records.result import TASK_FOLDER
from stlbench.records.result_files import cell_files
from stlbench.share import bundle as bundle_module
from stlbench.share.bundle import METADATA, check, results_in, unpacked
from stlbench.share.rescored import rescore

CELL, LINES = "zz-line/raw/zz-kept/0", "cells.jsonl"
OTHER = "its content is another than when it was packed"


def policy_of(bundle: Path) -> str:
    with zipfile.ZipFile(bundle) as archive:
        return next(name for name in archive.namelist() if name.startswith("policies/"))


def compressed(**arrays: object) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **{name.replace("_", "/"): np.asarray(array) for name, array in arrays.items()})
    return file.getvalue()


def test_what_was_packed_is_fine(bundle) -> None:
    assert check(bundle) == (1, 1, ())


@pytest.mark.parametrize(
    ("files", "problems"),
    [
        ({"report.md": b"# B report\n"}, [f"report.md: {OTHER}"]),
        ({"report.md": b"longer than it was"}, [f"report.md: 18 bytes, and {METADATA} says 11"]),
        ({"report.md": None, "extra.txt": b"?"}, [f"extra.txt: not in the list of {METADATA}", "report.md: missing"]),
    ],
)
def test_a_file_that_is_not_as_it_was_packed_is_named(bundle, tmp_path, files, problems) -> None:
    path = bundles.changed(bundle, tmp_path / "altered.zip", files)
    assert check(path).problems == tuple(problems)
    with pytest.raises(UsageError, match=r"is not scored: "):
        list(rescore(path))


@pytest.mark.parametrize(
    ("name", "rule"),
    [
        *((name, "not a path inside the bundle") for name in ("../out", "/tmp/out", "a\\b", "c:out", "a/../../out")),
        *((name, "no file of a bundle") for name in ("system.py", "policies/a.py", "policies/deep/a.npz", "traces")),
        *((name, "no file of a bundle") for name in ("x/cells.jsonl", LEDGER)),
    ],
)
def test_a_listed_file_that_no_bundle_holds_is_not_written(bundle, tmp_path, name, rule) -> None:
    with unpacked(bundles.told(bundle, tmp_path / "more.zip", {name: b"x"})) as (folder, problems):
        assert problems == (f"{name}: {rule}",)
        assert not [path for path in folder.rglob("*") if path.is_file() and path.read_bytes() == b"x"]
    assert not (tmp_path / "out").exists()


def test_results_and_policies_have_to_fit_even_where_the_checksums_do(bundle, tmp_path) -> None:
    policy, target = policy_of(bundle), tmp_path / "altered.zip"
    (said,) = check(bundles.told(bundle, target, {policy: compressed(selected_action=1, final_action=1)})).problems
    assert said.startswith(f"{policy} does not have the selected policy of {CELL}")
    for line in (b"{}\n", b"[" * 100_000, b'{"task": ' * 50_000, b"\xff\xfe", b"\x00"):
        (said,) = check(bundles.told(bundle, target, {LINES: line})).problems
        assert LINES in said
        assert len(said.splitlines()) == 1


def test_what_is_no_bundle_is_one_line(bundle, tmp_path) -> None:
    path = tmp_path / "x.zip"
    with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive:
        archive.writestr("a", "b")
    contents = (b"", b"PK\x03\x04 and then nothing", (tmp_path / "other.zip").read_bytes())
    for content, said in zip(contents, ("no bundle", "no bundle", f"has no {METADATA}"), strict=True):
        path.write_bytes(content)
        with pytest.raises(UsageError, match=said):
            check(path)
    with pytest.raises(UsageError, match="no bundle"):
        check(tmp_path / "nowhere.zip")
    for text in (b"[]", b"{", b'{"@graph": [{"@type": "File"}]}', b"\xff", b"[" * 100_000):
        with pytest.raises(UsageError, match="bundle"):
            check(bundles.changed(bundle, path, {METADATA: text}))


def test_flipped_bytes_never_are_a_traceback(bundle, tmp_path) -> None:
    data, random = bundle.read_bytes(), np.random.default_rng(0)
    found = 0
    for _ in range(50):
        broken = bytearray(data)
        broken[random.integers(len(data))] ^= 1 << random.integers(8)
        (tmp_path / "b.zip").write_bytes(broken)
        try:
            found += bool(check(tmp_path / "b.zip").problems)
        except UsageError:
            found += 1
    assert found > 30  # the rest fell on what no content depends on, as dates and flags of the zip


def test_code_that_a_ledger_names_is_not_run(bundle, tmp_path) -> None:
    """A ledger may say in which folder a task is, and to load that task runs what is there."""
    evil = tmp_path / "zz-evil"
    evil.mkdir()
    (evil / "task.yaml").write_text(line_task.text())
    (evil / "system.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\n{line_task.SYSTEM}")
    (result,) = bundles.results_of(bundle)
    with Ledger(tmp_path / LEDGER) as ledger:
        moved = replace(result.id, task=replace(result.id.task, name="zz-evil"))
        ledger.record(replace(result, id=moved, provenance={TASK_FOLDER: str(evil)}))
    say(tmp_path / LEDGER, "PRAGMA journal_mode=DELETE")
    path = bundles.told(bundle, tmp_path / "evil.zip", {LEDGER: (tmp_path / LEDGER).read_bytes()})
    assert check(path).problems == (f"{LEDGER}: no file of a bundle",)
    with unpacked(path) as (folder, _):
        assert [found.id.task.name for found in results_in(folder)] == ["zz-line"]
    with pytest.raises(UsageError, match="no file of a bundle"):
        list(rescore(path))
    assert not (tmp_path / "ran").exists()


def test_a_link_is_refused(bundle, tmp_path) -> None:
    secret = tmp_path / "secret.md"
    secret.write_text("nobody's business")
    path = bundles.told(bundle, tmp_path / "link.zip", {"link.md": str(secret).encode()})
    with zipfile.ZipFile(path) as source, zipfile.ZipFile(tmp_path / "linked.zip", "w") as copy:
        for info in source.infolist():
            if info.filename == "link.md":
                info.external_attr = (stat.S_IFLNK | 0o777) << 16
            copy.writestr(info, source.read(info.filename))
    with unpacked(tmp_path / "linked.zip") as (folder, problems):
        assert problems == ("link.md: a link, and no bundle has links",)
        assert not (folder / "link.md").exists()


def test_what_would_fill_the_memory_or_the_disk_is_not_read(bundle, tmp_path, monkeypatch) -> None:
    bomb = compressed(selected_action=np.zeros(2**22, np.uint8), final_action=1)
    files = {policy_of(bundle): bomb, "zeros.csv": bytes(2**22)}
    path = bundles.told(bundle, tmp_path / "bomb.zip", files)
    assert path.stat().st_size < 2**15 + bundle.stat().st_size + 2**22
    monkeypatch.setattr(bundle_module, "LARGEST_POLICIES", 2**20)
    monkeypatch.setattr(array_files, "read_arrays", lambda *_: pytest.fail("it was read"))
    assert check(path).problems == (f"{CELL}: its policies would be more than 1 MiB in memory",)
    monkeypatch.setattr(bundle_module, "LARGEST", 2**20)
    with pytest.raises(UsageError, match="more than 1 MiB unpacked"):
        check(path)
    monkeypatch.setattr(bundle_module, "_LIST", 1000)
    with pytest.raises(UsageError, match="its list of files is"):
        check(bundle)


def test_a_key_that_is_a_path_is_none(bundle, tmp_path) -> None:
    outside = cell_files(Path("x"), bundles.results_of(bundle)[0].id, "/../../out").policies
    assert ".." in str(outside)  # what a key would reach
    path = bundles.claiming(bundle, tmp_path / "key.zip", lambda result: replace(result, key="/../../out"))
    assert check(path).problems == (f"{CELL}: its key is none",)


def test_names_that_steer_a_terminal_are_shown_as_text(bundle, tmp_path) -> None:
    (said,) = check(bundles.changed(bundle, tmp_path / "colour.zip", {"\x1b[2J\u202egnp.exe": b"1"})).problems
    assert said.isprintable()


def test_a_worse_policy_under_the_numbers_of_a_better_one_is_found(bundle, tmp_path) -> None:
    data, digest = compressed(selected_action=2), array_files.digest({"action": np.array(2)})

    def swapped(result):
        policies = replace(result.measurement.policies, selected=digest, final=digest)
        return replace(result, measurement=replace(result.measurement, policies=policies))

    one = bundles.told(bundle, tmp_path / "1.zip", {policy_of(bundle): data})
    path = bundles.claiming(one, tmp_path / "2.zip", swapped)
    assert check(path).problems == ()
    (found,) = rescore(path)
    assert found.verdict == "claims more"


def test_a_disk_that_cannot_take_a_bundle_is_no_damage_of_it(bundle, monkeypatch) -> None:
    @contextmanager
    def full(path, *_):
        raise DiskFull(f"cannot write {path}: No space left on device")
        yield

    monkeypatch.setattr(bundle_module, "opened", full)
    with pytest.raises(DiskFull, match=r"cannot write .*: No space left"):
        check(bundle)
    monkeypatch.undo()

    def nowhere(**_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tempfile.TemporaryDirectory", nowhere)
    with pytest.raises(DiskFull, match="cannot make a temporary folder: No space left"):
        check(bundle)


def test_a_size_that_is_no_number_is_one_line(bundle, tmp_path) -> None:
    with zipfile.ZipFile(bundle) as archive:
        text = archive.read(METADATA).replace(b'"contentSize": "', b'"contentSize": 1e999, "z": "', 1)
    with pytest.raises(UsageError, match="is not that of a bundle of stlbench: OverflowError"):
        check(bundles.changed(bundle, tmp_path / "inf.zip", {METADATA: text}))
