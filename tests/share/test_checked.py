"""What `check` finds in bundles that somebody changed, by accident or not."""

from __future__ import annotations

import zipfile

import numpy as np
import pytest
from helpers import bundles

from stlbench.errors import UsageError
from stlbench.records import npz
from stlbench.share.bundle import METADATA
from stlbench.share.checked import check, unpacked

LINES = "cells.jsonl"


@pytest.fixture
def bundle(site, tmp_path):
    return bundles.packed(site, tmp_path)[0]


@pytest.fixture
def altered(bundle, tmp_path):
    """The bundle with other files; `told` has the list in its metadata say what they are now."""

    def alter(files, told=False):
        return (bundles.told if told else bundles.changed)(bundle, tmp_path / "altered.zip", files)

    return alter


def policy_of(bundle) -> str:
    with zipfile.ZipFile(bundle) as archive:
        return next(name for name in archive.namelist() if name.startswith("policies/"))


def test_what_was_packed_is_fine(bundle) -> None:
    assert check(bundle) == (1, 1, ())


def test_a_changed_file_is_named(altered) -> None:
    assert check(altered({"report.md": b"# B report\n"})).problems == (
        "report.md: its content is another than when it was packed",
    )
    (said,) = check(altered({"report.md": b"longer than it was"})).problems
    assert said == f"report.md: 18 bytes, and {METADATA} says 11"


def test_a_missing_and_a_further_file_are_named(altered) -> None:
    assert check(altered({"report.md": None, "extra.txt": b"?"})).problems == (
        f"extra.txt: not in the list of {METADATA}",
        "report.md: missing",
    )


def test_results_and_policies_have_to_fit_even_where_the_checksums_do(bundle, altered, tmp_path) -> None:
    policy = policy_of(bundle)
    npz.write(tmp_path / "other.npz", {"selected/action": np.array(1), "final/action": np.array(1)})
    (said,) = check(altered({policy: (tmp_path / "other.npz").read_bytes()}, told=True)).problems
    assert said.startswith(f"{policy} does not have the selected policy of zz-line/raw/zz-kept/0")
    (said,) = check(altered({LINES: b"{}\n"}, told=True)).problems
    assert said.startswith(f"{LINES}, line 1: not a result")


@pytest.mark.parametrize("name", ["../out", "/tmp/out", "a\\b", "c:out", "a/../../out"])
def test_no_file_is_written_outside(altered, tmp_path, name) -> None:
    with unpacked(altered({name: b"x"}, told=True)) as (folder, problems):
        assert f"{name}: not a path inside the bundle" in problems
        assert not list(folder.rglob("*out*"))
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("content", "said"), [(b"", "no bundle"), (b"PK\x03\x04 and then nothing", "no bundle"), (None, "no bundle")]
)
def test_what_is_no_zip_is_one_line(tmp_path, content, said) -> None:
    path = tmp_path / "x.zip"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UsageError, match=said):
        check(path)


def test_another_zip_is_no_bundle(tmp_path, altered) -> None:
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
        archive.writestr("a", "b")
    with pytest.raises(UsageError, match=f"has no {METADATA}"):
        check(tmp_path / "x.zip")
    for text in (b"[]", b"{", b'{"@graph": [{"@type": "File"}]}', b"\xff", b"[" * 100_000):
        with pytest.raises(UsageError, match="bundle"):
            check(altered({METADATA: text}))


def test_flipped_bytes_never_are_a_traceback(bundle, tmp_path) -> None:
    data, random = bundle.read_bytes(), np.random.default_rng(0)
    found = 0
    for _ in range(100):
        broken = bytearray(data)
        broken[random.integers(len(data))] ^= 1 << random.integers(8)
        (tmp_path / "b.zip").write_bytes(broken)
        try:
            found += bool(check(tmp_path / "b.zip").problems)
        except UsageError:
            found += 1
    assert found > 60  # the rest fell on what no content depends on, as dates and flags of the zip
