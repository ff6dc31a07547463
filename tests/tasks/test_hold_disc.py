"""The comparative study of the paper: its numbers, and the robot's motion by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.controlled_traces import all_starts, trace

from stlbench import stl
from stlbench.task import load_task, starts

TASK = load_task("hold-disc")


def test_the_paper() -> None:
    """Comparative Study: G[0,200] of the disc at (2,2) of radius 1, with the robot of sec. IV-B."""
    file = TASK.file
    assert TASK.formula == stl.parse("G[0,200] (norm(x - 2, y - 2) <= 1)")
    assert (file.sampling_time, file.steps, file.hold) == (0.01, 200, 1)
    assert TASK.actions.names == ("v", "omega")
    assert TASK.actions.axes == (
        (-5, -4.5, -4, -3.5, -3, -2.5, -2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4, 4.5, 5),
        (-3, -2.5, -2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2, 2.5, 3),
    )


def test_the_protocols_measure_what_the_authors_program_prints() -> None:
    # the minimum over steps 100..200; of one episode under the name `paper`
    protocols = TASK.file.protocols
    assert {protocols[name].formula for name in ("paper", "tail")} == {
        stl.parse("G[100,200] (norm(x - 2, y - 2) <= 1)")
    }
    assert (protocols["paper"].starts, protocols["tail"].starts) == (1, 64)
    region = protocols["centre"].initial
    assert region is not None
    assert np.all(starts.grid(region, 16)[:, :2] == 2)


def test_features_are_the_centre_as_seen_from_the_robot() -> None:
    # At (2, 1) looking along x, and along y: the centre is 1 m to the left, and 1 m ahead.
    state = np.array([[2.0, 1.0, 0.0], [2.0, 1.0, math.pi / 2], [2.0, 1.0, math.pi]])
    near = math.tanh(1 / 0.2)
    expected = [[0, 1, 0, near], [1, 0, near, 0], [0, -1, 0, -near]]
    assert TASK.system.features(state, np.zeros(3, dtype=np.int64)) == pytest.approx(np.array(expected))


@pytest.mark.parametrize(("name", "settled"), [("hold-disc", 0.98), ("hold-disc-coarse", 0.97)])
def test_the_controller_never_leaves_its_start_and_settles_at_the_centre(name: str, settled: float) -> None:
    """1 - r, the most from a start at radius r, and over steps 100..200 what the grid of speeds leaves of 1."""
    task = load_task(name)
    states = all_starts(task)
    traces = trace(task, states)
    best = 1 - np.hypot(states[:, 0] - 2, states[:, 1] - 2)
    assert stl.robustness(task.formula, traces, task.signals) == pytest.approx(best)
    tail = task.file.protocols["tail"].formula
    assert tail is not None
    assert stl.robustness(tail, traces, task.signals).min() > settled
