"""Traces of a run, found again or said to be missing."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest
from helpers import synthetic_results
from helpers.line_task import Probe, Rule, line

from stlbench.errors import UsageError
from stlbench.records.array_files import read_saved
from stlbench.records.result_files import cell_files
from stlbench.simulation.referee import Recording, Referee, gather, load

RESULT = synthetic_results.result(task="line")
TRACES = np.arange(18.0).reshape(2, 9, 1)


@pytest.fixture
def save(tmp_path):
    path = cell_files(tmp_path, RESULT.id, RESULT.key).traces
    path.parent.mkdir(parents=True)

    def write(**content):
        np.savez_compressed(path, **content)
        return path

    return write


def test_what_was_saved_is_loaded(save, tmp_path):
    with pytest.raises(UsageError, match=r"^line/funnel/dqn/0 has no traces at "):
        load(line(), RESULT, tmp_path)
    save(traces=TRACES, signals=["x"], extremes=[1, 0], states=np.ones((2, 9, 1)))
    found = load(line(), RESULT, tmp_path)
    assert np.array_equal(found.traces, TRACES)
    assert found.film is not None
    assert (found.film.starts.tolist(), found.film.states.shape) == ([1, 0], (2, 9, 1))
    save(traces=TRACES, signals=["x"])
    assert load(line(), RESULT, tmp_path).film is None  # an older file


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"traces": TRACES, "signals": ["y"]}, "are of another version of the task line"),
        ({"traces": TRACES[:, :5], "signals": ["x"]}, "are of another version of the task line"),
        ({"traces": TRACES[..., 0], "signals": ["x"]}, r"traces have shape \(starts, steps, 1 signals\), got \(2, 9\)"),
        ({"signals": ["x"]}, r"cannot read .* as traces of stlbench"),
    ],
)
def test_traces_that_do_not_fit_are_refused(save, tmp_path, content, message):
    save(**content)
    with pytest.raises(UsageError, match=message):
        load(line(), RESULT, tmp_path)


def test_damage_anywhere_is_a_usage_error(save, tmp_path):
    """Of the headers and the compressed data: what then fails is zipfile, zlib or NumPy."""
    path = save(traces=TRACES, signals=["x"])
    whole = path.read_bytes()
    for place in range(0, len(whole), 3):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        with contextlib.suppress(UsageError):  # many a byte does not count
            load(line(), RESULT, tmp_path)
        with contextlib.suppress(UsageError):
            read_saved(path)
    with path.open("wb") as file:
        np.save(file, TRACES)  # one array, and no archive
    for content in (path.read_bytes(), b"", whole[:10], whole[:200]):
        path.write_bytes(content)
        with pytest.raises(UsageError, match=r"cannot read .* as traces of stlbench"):
            load(line(), RESULT, tmp_path)


def test_seeds_are_gathered_and_shown_evenly():
    traces = np.arange(36.0).reshape(4, 9, 1)
    found = gather([Recording(traces, 1), Recording(100 + traces, 1)])
    assert (found.seeds, len(found.traces)) == (2, 8)
    assert found.evenly(3)[:, 0, 0].tolist() == [0, 100, 127]
    assert len(found.evenly(50)) == 8
    assert found.evenly(1).shape == (1, 9, 1)


def test_the_referee_keeps_the_states_at_each_decision():
    """Always up from x_0: half a metre per step, a decision every 4 steps."""
    task = line(hold=4)
    report = Referee(task, Probe(task.specification)).assess(Rule(lambda seen: 2))
    assert report.states.shape == (4, 3, 1)
    assert np.array_equal(report.states, report.traces[:, ::4])
    assert report.states[0, :, 0] - report.states[0, 0, 0] == pytest.approx([0, 2, 4])
