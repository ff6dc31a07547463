"""Recorded traces of episodes that ended early: judged as the referee judges such episodes."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from helpers.line_task import Probe, Rule, line
from helpers.walk_task import WalkTask, walk

from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.records.array_files import Assessment, save_traces
from stlbench.records.result import MAIN
from stlbench.share.scoring import Shown, score
from stlbench.share.source import find_source, load_traces
from stlbench.simulation.referee import Referee
from stlbench.task import Task

RULES = ("hold", "violated", "interval")
SHORT = "time,x\n0,0\n.5,.5\n1,1\n"


def ending(terminated: str) -> Task:
    """x goes from 0 by .5 a step to its wall at 1, so that 3 of 9 samples are recorded."""
    return walk(WalkTask(wall=1.0), terminated=terminated, formula="G[0,4] x <= 2")


def assessed(task: Task) -> Assessment:
    return Referee(task, Probe(task.specification)).assess(Rule(lambda seen: 2))


@pytest.mark.parametrize("terminated", RULES)
def test_what_the_referee_recorded_gets_the_score_that_it_gave(tmp_path: Path, terminated: str) -> None:
    task, path = ending(terminated), tmp_path / "cell.npz"
    found = assessed(task)
    save_traces(path, found, task.signals)
    scored = score(task, find_source(str(path)), Shown(), 0)
    assert scored.measurement.selected == {MAIN: found.scores[MAIN]}
    assert np.array_equal(scored.assessment.traces, found.traces, equal_nan=True)
    assert scored.starts == "the report's starts"


@pytest.mark.parametrize("terminated", RULES)
@pytest.mark.parametrize("text", [SHORT, SHORT + "1.5,nan\n2,NaN\n", "x,y\n0,1\n.5,1\n1,1\n,1\n,nan\n"])
def test_a_table_that_is_short_or_ends_with_nan(tmp_path: Path, terminated: str, text: str) -> None:
    (tmp_path / "t.csv").write_text(text)
    task = ending(terminated)
    assert np.array_equal(load_traces(tmp_path / "t.csv", task).traces, assessed(task).traces[:1], equal_nan=True)


@pytest.mark.parametrize("title", ["time", "Time (s)", "t_ms", "timestamp [ns]"])
def test_a_table_as_programs_write_it(tmp_path: Path, title: str) -> None:
    """Compressed, with the index of pandas, units, and times in another unit, which are checked."""
    factor = {"t_ms": 1000, "timestamp [ns]": 10**9}.get(title, 1)
    text = f",{title},/robot/y,x [m]\n" + "".join(f"{i},{int(i * factor / 2) or i / 2},a,{i / 2}\n" for i in range(3))
    (tmp_path / "t.csv.gz").write_bytes(gzip.compress(text.encode()))
    task = ending("hold")
    loaded = load_traces(find_source(str(tmp_path / "t.csv.gz")).path, task)
    assert np.array_equal(loaded.traces, assessed(task).traces[:1])
    (tmp_path / "t.csv").write_text(text.replace("\n1,", "\n1,1"))
    with pytest.raises(UsageError, match=r"row 3 has .*, .* is expected with a sampling time of 0.5 s"):
        load_traces(tmp_path / "t.csv", task)


def traces_of(path: Path, samples: Array) -> Path:
    np.savez(path / "t.npz", traces=samples, signals=np.array(["x"]))
    return path / "t.npz"


def test_traces_of_different_lengths(tmp_path: Path) -> None:
    samples = np.zeros((2, 5, 1))
    samples[1, 3:] = np.nan
    found = load_traces(traces_of(tmp_path, samples), ending("violated")).traces
    assert np.isfinite(found).sum(axis=(1, 2)).tolist() == [5, 3]
    assert found.shape == (2, 9, 1)


@pytest.mark.parametrize(
    ("value", "rows", "message"),
    [
        (np.nan, slice(2, 3), "trace 0, row 2, x is nan; a finite number is expected, or NaN in all signals from a"),
        (np.nan, slice(0, 9), "trace 0, row 0, x is nan; a finite number is expected"),
        (np.inf, slice(8, 9), "trace 0, row 8, x is inf; a finite number is expected"),
    ],
)
def test_what_is_no_early_end(tmp_path: Path, value: float, rows: slice, message: str) -> None:
    samples = np.zeros((1, 9, 1))
    samples[:, rows] = value
    with pytest.raises(UsageError, match=message):
        load_traces(traces_of(tmp_path, samples), ending("violated"))


def test_a_table_with_a_hole_or_too_many_rows(tmp_path: Path) -> None:
    (tmp_path / "hole.csv").write_text("x\n0\nnan\n1\n")
    with pytest.raises(UsageError, match=r"row 3, column 1 .* 'nan' is no finite number"):
        load_traces(tmp_path / "hole.csv", ending("violated"))
    (tmp_path / "long.csv").write_text("x\n" + "0\n" * 10)
    with pytest.raises(UsageError, match=r"long.csv has 10 rows; an episode of walk has 9, one at the start"):
        load_traces(tmp_path / "long.csv", ending("violated"))


def test_the_episodes_of_a_system_never_end_early(tmp_path: Path) -> None:
    task = line()
    samples = np.zeros((1, task.file.steps + 1, 1))
    samples[:, -1] = np.nan
    with pytest.raises(UsageError, match=r"x is nan; a finite number is expected$"):
        load_traces(traces_of(tmp_path, samples), task)
    with pytest.raises(UsageError, match="rows; an episode of line has"):
        load_traces(traces_of(tmp_path, samples[:, :-1]), task)
