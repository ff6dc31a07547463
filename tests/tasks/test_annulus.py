"""The convex predicate, eq. 19 of the paper."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stlbench import stl
from stlbench.task import load_task

TASK = load_task("annulus")


def test_the_paper() -> None:
    """Eq. 19 with the robot of sec. IV-B, reset anywhere in [0,15] x [0,15]."""
    assert TASK.formula == stl.parse("G[300,2000] (norm(x - 5, y - 5) >= 2 & norm(x - 5, y - 5) <= 5)")
    assert (TASK.file.sampling_time, TASK.file.steps) == (0.01, 2000)
    assert (TASK.actions.names, TASK.actions.shape) == (("v", "omega"), (21, 13))
    assert TASK.file.initial.low[:2].tolist() == [0, 0]
    assert TASK.file.initial.high[:2].tolist() == [15, 15]


@pytest.mark.parametrize(("radius", "robustness"), [(3.5, 1.5), (2.25, 0.25), (4.0, 1.0), (1.0, -1.0), (7.0, -2.0)])
def test_robustness_by_hand(radius: float, robustness: float) -> None:
    """On a circle of a given radius: the distance to the nearer edge, from step 300 on."""
    angle = np.linspace(0, 20, 2001)
    circle = 5 + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[None]
    circle[:, :300] = 15
    assert stl.robustness(TASK.formula, circle, TASK.signals) == pytest.approx(robustness)


def test_features_by_hand() -> None:
    """From (8, 9) the centre is 5 m off in direction (-3, -4); from (5, 5) it is here."""
    away = math.atan2(4, 3)
    state = np.array([[8.0, 9.0, away], [8.0, 9.0, away + math.pi / 2], [5.0, 5.0, 1.0], [5.0, 8.5, 0.0]])
    features = TASK.system.features(state, np.array([0, 1000, 2000, 0]))
    near, out = math.tanh(5), math.tanh(1.5)
    expected = [[0.3, out, -near, 0], [0.3, out, 0, near], [-0.7, math.tanh(-3.5), 0, 0], [0, 0, 0, -math.tanh(3.5)]]
    assert features == pytest.approx(np.array(expected), abs=1e-12)


def test_the_controller_by_hand() -> None:
    """Facing the centre from (12, 5): ahead. From (6, 5): back. From (8.2, 5): .3 m in a tenth of a second, 3 m/s."""
    state = np.array([[12.0, 5.0, math.pi], [6.0, 5.0, math.pi], [8.2, 5.0, 0.0]])
    action = TASK.system.controller(state, np.zeros(3, dtype=np.int64))
    assert action is not None
    assert action == pytest.approx(np.array([[5, 0], [-5, 0], [3, 0]]))
