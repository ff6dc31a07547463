"""Mobile robot navigation, sec. IV-B of the paper."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stlbench import stl
from stlbench.task import load_task

TASK = load_task("robot-nav")


def test_the_paper() -> None:
    expected = "G[900,1300] (norm(x - 25, y - 25) <= 2) & G[1600,2000] (norm(x - 30, y - 30) <= 2)"
    assert TASK.formula == stl.parse(expected)
    assert (TASK.file.sampling_time, TASK.file.steps) == (0.01, 2000)
    assert TASK.actions.names == ("v", "omega")
    assert TASK.actions.shape == (21, 13)
    assert TASK.actions.vectors[[0, 1, 13, -1]].tolist() == [[-5, -3], [-5, -2.5], [-4.5, -3], [5, 3]]


def test_features_speak_of_the_goal_of_now() -> None:
    """From (22, 21): (25, 25) is 5 m off in the direction of (3, 4), (30, 30) is sqrt(145) m off."""
    heading = math.atan2(4, 3)
    state = np.array([[22.0, 21.0, heading], [22.0, 21.0, heading - math.pi / 2], [22.0, 21.0, heading]])
    features = TASK.system.features(state, np.array([0, 1299, 1300]))
    near = math.tanh(5)
    assert features[0] == pytest.approx([5 / 20 - 1, math.tanh(2.5), near, 0, 1, -1])
    assert features[1] == pytest.approx([5 / 20 - 1, math.tanh(2.5), 0, near, 0, -1])
    far = math.sqrt(145)
    # cosine of the angle between (3, 4) / 5 and (8, 9) / sqrt(145), the sine by the cross product
    assert features[2] == pytest.approx(
        [far / 20 - 1, math.tanh(far / 2), 60 / 5 / far, (3 * 9 - 4 * 8) / 5 / far, 60 / 5 / far, 1], abs=1e-9
    )


def test_the_controller_heads_for_the_region_of_now() -> None:
    """Between the regions' centres, looking along the diagonal: ahead to the second one, back to the first one."""
    state = np.tile([27.5, 27.5, math.pi / 4], (2, 1))
    action = TASK.system.controller(state, np.array([1300, 1299]))
    assert action is not None
    assert action == pytest.approx(np.array([[5, 0], [-5, 0]]))
