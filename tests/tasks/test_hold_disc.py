"""The comparative study of the paper: its numbers, and the robot's motion by hand."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.controlled_traces import all_starts, trace

from stlbench import stl
from stlbench.task import load_task, starts

TASK = load_task("hold-disc")


def test_the_protocols_measure_what_the_authors_program_prints() -> None:
    # the minimum over steps 100..200; of one episode under the name `paper`
    protocols = TASK.file.protocols
    late = stl.parse("G[100,200] (norm(x - 2, y - 2) <= 1)")
    assert protocols["paper"].formula == protocols["tail"].formula == late
    assert (protocols["paper"].starts, protocols["tail"].starts) == (1, 64)
    region = protocols["centre"].initial
    assert region is not None
    assert np.all(starts.grid(region, 16)[:, :2] == 2)


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
