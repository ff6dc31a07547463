"""The inverted pendulum, sec. IV-A of the paper."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stlbench import stl
from stlbench.task import load_task

TASK = load_task("pendulum")


def test_what_methods_are_told() -> None:
    """Errors and speeds in tolerances: 0.1 is two. A speed is at most 5; an error beyond 0.25 adds one per radian."""
    margins = [TASK.specification.margin(term.psi) for term in TASK.specification.terms]
    states = np.array([[0, 0], [0.1, 0], [-1.25, 0], [0, -0.1], [0, 3], [0.05 - 1e-9, 0], [0, 0.05 + 1e-9]])
    expected = [1, -1, -5, -1, -4, 0, 0]
    for margin, target in zip(margins, (0, 1.57, -1.57), strict=True):
        found = margin(states + np.array([target, 0.0]))
        assert found == pytest.approx(expected, abs=1e-7)
        assert (found >= 0).tolist() == [True, False, False, False, False, True, False]


def test_the_angle_is_not_wrapped() -> None:
    """A whole turn above the target violates the formula, and the features tell it from the target."""
    angles = np.zeros((1, 2001, 2))
    angles[0, 701:1201, 0], angles[0, 1201:, 0] = 1.57, -1.57
    assert stl.robustness(TASK.formula, angles, TASK.signals) == pytest.approx(0.05)
    assert stl.robustness(TASK.formula, angles + np.array([2 * math.pi, 0]), TASK.signals) == pytest.approx(
        0.05 - 2 * math.pi
    )
    features = TASK.system.features(np.array([[0.0, 0.0], [2 * math.pi, 0.0]]), np.array([0, 0]))
    assert features[:, 0] == pytest.approx([0, math.pi])


def test_robustness_is_that_of_the_conjunction() -> None:
    """The larger of the two deviations counts: at theta = .02, omega = .04 it is .05 - .04."""
    angles = np.zeros((1, 2001, 2))
    angles[0, 701:1201, 0], angles[0, 1201:, 0] = 1.57, -1.57
    angles[0, 1100] = 1.59, 0.04
    assert stl.robustness(TASK.formula, angles, TASK.signals) == pytest.approx(0.01)
