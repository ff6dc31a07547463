"""Why a trace has its robustness: hold-disc asks G[0,200] norm(x - 2, y - 2) <= 1."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench.contract import Array
from stlbench.simulation.verdicts import first_loss, last_step, reason
from stlbench.task import load_task

TASK = load_task("hold-disc")


def trace(*distances: tuple[int, float]) -> Array:
    """At the centre, and from these steps on so far to the right of it."""
    samples = np.full((201, 2), 2.0)
    for step, distance in distances:
        samples[step:, 0] = 2.0 + distance
    return samples


def test_the_least_margin_and_the_first_step_outside() -> None:
    found, lost = reason(TASK, trace((100, 1.25), (150, 1.5))), first_loss(TASK, trace((100, 1.25), (150, 0.5)))
    assert found is not None
    assert (found.step, found.margin) == (150, pytest.approx(-0.5))
    assert lost is not None
    assert (str(lost.conjunct), lost.step) == (str(TASK.formula), 100)
    assert first_loss(TASK, trace((100, 0.5))) is None


def test_of_a_conjunction_the_part_that_is_lost_first() -> None:
    task = load_task("robot-nav")  # G[900,1300] near (25, 25) & G[1600,2000] near (30, 30)
    samples = np.full((2001, len(task.signals)), 25.0)
    samples[1000:1010] = 0.0
    found = first_loss(task, samples)
    assert found is not None
    assert "[900,1300]" in str(found.conjunct)
    assert found.step == 1000


def test_an_early_end_decides() -> None:
    ended = trace((100, 0.5))
    ended[120:] = np.nan
    assert last_step(ended) == 119
    assert reason(TASK, ended) is None
    assert first_loss(TASK, ended) is None
