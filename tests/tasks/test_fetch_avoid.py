"""The Fetch arm that brings its gripper round a ball to a point, and holds it there."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array
from stlbench.simulation import baselines, referee
from stlbench.task import load_task

pytest.importorskip("mujoco", reason="the extra mujoco is not installed")
TASK, ARM = load_task("fetch-avoid"), load_task("fetch-reach")
BALL = np.array([1.4, 0.58, 0.5])


def test_the_arm_is_that_of_fetch_reach() -> None:
    assert type(TASK.system).step is type(ARM.system).step
    assert (TASK.file.sampling_time, TASK.actions, TASK.signals) == (ARM.file.sampling_time, ARM.actions, ARM.signals)
    assert stl.horizon(TASK.formula) == TASK.file.steps == 100


def test_robustness_by_hand() -> None:
    """The gripper is .25 m from the ball's middle, then 0.03 m from the point, whose ball has 0.05 m: 0.02.

    It comes at step 50, which is in time; a step later is not: then step 50 counts, .25 m from the point. In the ball,
    0.03 and 0.04 m off its middle, it is 0.05 m too deep.
    """
    trace = np.empty((101, 3))
    trace[:50], trace[50:] = (1.4, 0.73, 0.7), (1.43, 0.4, 0.5)
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(0.02)
    late = trace.copy()
    late[50] = 1.4, 0.55, 0.7
    assert stl.robustness(TASK.formula, late, TASK.signals) == pytest.approx(0.05 - 0.25)
    trace[20] = 1.4, 0.61, 0.54
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(-0.05)


def test_the_straight_way_goes_through_the_ball() -> None:
    """All starts are on the far side of the ball, and each straight way to the point leads through it."""
    starts = TASK.starts.report_and_selection()[0][::8]
    assert (np.linalg.norm(TASK.system.signals(starts) - BALL, axis=1) > 0.15).all()

    def straight(state: Array, t: Array) -> Array:
        return np.clip(8 * (np.array([1.4, 0.4, 0.5]) - state[:, 45:48]), -1, 1)

    with patch.object(TASK.system, "controller", straight):
        episodes = baselines.record_controller(TASK, starts)
    assert episodes is not None
    assert max(referee.score(TASK, episodes.traces).robustness) < -0.05
    assert (np.linalg.norm(episodes.traces[:, 50:] - [1.4, 0.4, 0.5], axis=-1) < 0.05).all()


def test_the_way_by_hand() -> None:
    """Where y is above .56 it aims at (1.4, .55, .74), else at the point: 8 a metre, 1 at most."""
    state = np.zeros((2, 51))
    state[:, 45:48] = (1.35, 0.75, 0.7), (1.4, 0.45, 0.6)
    actions = TASK.system.controller(state, np.zeros(2, dtype=np.int64))
    assert actions == pytest.approx(np.array([[0.4, -1, 0.32], [0, -0.4, -0.8]]))
