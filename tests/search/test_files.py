"""The files of a counterexample are read by what reads other traces, and say the same robustness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.made_subjects import still

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.records.array_files import read_saved
from stlbench.search import outputs
from stlbench.search.falsify import Falsification, How, falsify
from stlbench.search.outputs import write
from stlbench.share.trace_table import read_table, times_of


@pytest.fixture(scope="module")
def found() -> Falsification:
    return falsify(still("G[0,8] a <= -0.2"), How(evaluations=300))


@pytest.fixture(scope="module")
def paths(found: Falsification, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return write(found, tmp_path_factory.mktemp("found") / "deep" / "down")


def test_all_five(paths: list[Path]) -> None:
    assert [path.name for path in paths] == [
        f"counterexample-still.{end}" for end in ("npz", "csv", "png", "svg", "pdf")
    ]
    assert all(path.stat().st_size for path in paths)


def test_the_arrays_and_the_table(found: Falsification, paths: list[Path]) -> None:
    saved, task = read_saved(paths[0]), found.actor.task
    assert stl.robustness(task.formula, saved.samples, saved.names) == [found.worst.robustness]
    with np.load(paths[0]) as arrays:
        start = dict(zip(arrays["coordinates"].tolist(), arrays["start"].tolist(), strict=True))
    assert start == found.start
    table = read_table(paths[1])
    times = times_of(table)
    assert times is not None
    times.check(task.file.sampling_time)
    assert stl.robustness(task.formula, table.samples(task.signals), table.names) == found.worst.robustness


def test_without_a_counterexample_the_name_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outputs, "save", lambda figure, folder, name: [])
    satisfied = falsify(still("G[0,8] a <= 1"), How(evaluations=50))
    assert write(satisfied, tmp_path)[0].name == "least-still.npz"


def test_a_folder_that_cannot_be_written(found: Falsification, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"cannot write .*\.npz: "):
        write(found, tmp_path / "file")
