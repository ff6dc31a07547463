"""The files of a counterexample are read by what reads other traces, and say the same robustness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.made_subjects import still

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.records.saved_traces import read_saved
from stlbench.rollout.trace_table import read_table
from stlbench.search.falsify import Falsification, How, falsify
from stlbench.search.outputs import write


@pytest.fixture(scope="module")
def found() -> Falsification:
    return falsify(still("G[0,8] a <= -0.2"), How(evaluations=300))


def test_all_four(found: Falsification, tmp_path: Path) -> None:
    paths = write(found, tmp_path / "deep" / "down")
    assert [path.name for path in paths] == [
        f"counterexample-still.{end}" for end in ("npz", "csv", "png", "svg", "pdf")
    ]
    assert all(path.stat().st_size for path in paths)


def test_the_arrays(found: Falsification, tmp_path: Path) -> None:
    path = write(found, tmp_path)[0]
    saved = read_saved(path)
    assert stl.robustness(found.actor.task.formula, saved.samples, saved.names) == [found.worst.robustness]
    with np.load(path) as arrays:
        start = dict(zip(arrays["coordinates"].tolist(), arrays["start"].tolist(), strict=True))
    assert start == found.start


def test_the_table(found: Falsification, tmp_path: Path) -> None:
    table, task = read_table(write(found, tmp_path)[1]), found.actor.task
    table.check_times(task.file.sampling_time)
    samples = table.samples(task.signals)
    assert stl.robustness(task.formula, samples, table.names) == found.worst.robustness


def test_without_a_counterexample_the_name_says_so(tmp_path: Path) -> None:
    satisfied = falsify(still("G[0,8] a <= 1"), How(evaluations=50))
    assert write(satisfied, tmp_path)[0].name == "least-still.npz"


def test_a_folder_that_cannot_be_written(found: Falsification, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UsageError, match=r"cannot write .*\.npz: "):
        write(found, tmp_path / "file")
