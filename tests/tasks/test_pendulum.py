"""The inverted pendulum, sec. IV-A of the paper."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from stlbench import stl
from stlbench.task import load_task

TASK = load_task("pendulum")


def test_the_paper() -> None:
    """Eq. 14 at 0.01 s, torques -3, -2.9, ... 3; gamma_0 = pi of its first interval."""
    parts = [
        f"G[{a},{b}] (abs({target} - theta) <= 0.05 & abs(omega) <= 0.05)"
        for a, b, target in ((1000, 1200, 1.57), (1700, 2000, -1.57))
    ]
    first = "G[400,700] (abs(theta) <= 0.05 & abs(omega) <= 0.05)"
    assert TASK.formula == stl.parse(" & ".join([first, *parts]))
    assert (TASK.file.sampling_time, TASK.file.steps, TASK.file.hold) == (0.01, 2000, 1)
    assert TASK.actions.names == ("torque",)
    assert TASK.actions.axes == (tuple(round(-3 + 0.1 * i, 12) for i in range(61)),)
    low, high = replace(TASK.specification, formula=TASK.formula).range(stl.fragment(TASK.formula)[0].psi)
    assert high - low == pytest.approx(math.pi)


def test_what_methods_are_told() -> None:
    """Errors and speeds in tolerances: 0.1 is two. A speed is at most 5; an error beyond 0.25 adds one per radian."""
    margins = [TASK.specification.margin(term.psi) for term in TASK.specification.terms]
    states = np.array([[0, 0], [0.1, 0], [-1.25, 0], [0, -0.1], [0, 3], [0.05 - 1e-9, 0], [0, 0.05 + 1e-9]])
    expected = [1, -1, -5, -1, -4, 0, 0]
    for margin, target in zip(margins, (0, 1.57, -1.57), strict=True):
        found = margin(states + np.array([target, 0.0]))
        assert found == pytest.approx(expected, abs=1e-7)
        assert (found >= 0).tolist() == [True, False, False, False, False, True, False]


def test_the_reward_changes_where_returns_are_cut() -> None:
    """Beyond an interval's end the paper's reward, eq. 15, speaks of the next target."""
    ends = [term.end for term in TASK.specification.terms]
    assert (*TASK.file.training.cuts, 2000) == tuple(ends) == (700, 1200, 2000)


def test_dynamics_by_hand() -> None:
    """g/l = 19.6, m l^2 = .0375, mu/(m l^2) = 4/3; omega moves theta one step later."""
    state = np.array([[0.0, 0.0], [math.pi / 2, 3.0], [math.pi / 6, 0.0], [4.0, -100.0]])
    after = TASK.system.step(state, np.array([[3.0], [0.0], [-0.75], [0.0]]))
    expected = [
        [0, 0.8],  # .01 * 3 / .0375
        [math.pi / 2 + 0.03, 3 + 0.196 - 0.04],
        [math.pi / 6, 0.098 - 0.2],  # sin = .5
        [3.0, -100 + 0.196 * math.sin(4) + 4 / 3],
    ]
    assert after == pytest.approx(np.array(expected))
    assert TASK.system.signals(state).tolist() == state.tolist()


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


def test_features_by_hand() -> None:
    """At (1, -2): errors 1, -.57, 2.57 of the three phases, which begin at 0, 700 and 1200."""
    t = np.array([0, 699, 700, 1199, 1200, 1700])
    features = TASK.system.features(np.tile([1.0, -2.0], (6, 1)), t)
    errors = [1, 1, -0.57, -0.57, 2.57, 2.57]
    assert features[:, 0] == pytest.approx(np.array(errors) / 2)
    assert features[:, 1] == pytest.approx(np.tanh(np.array(errors) / 0.3))
    assert features[:, 2] == pytest.approx(np.tanh(np.array(errors) / 0.05))
    assert features[:, 3:6] == pytest.approx(np.tile([-1, math.tanh(-2 / 0.3), math.tanh(-40)], (6, 1)))
    assert features[:, 6].tolist() == [-1, -1, 0, 0, 1, 1]


def test_the_deadline_passes_the_tolerance_where_an_interval_begins() -> None:
    """log(pi) at the start of each phase, log(.05) at its interval, about log(.03) at its end; over 2, plus 1."""
    t = np.array([0, 700, 1200, 400, 1000, 1700, 700 - 1])
    deadline = TASK.system.features(np.zeros((7, 2)), t)[:, 7]
    assert deadline[:3] == pytest.approx(math.log(math.pi) / 2 + 1)
    assert deadline[3:6] == pytest.approx(math.log(0.05) / 2 + 1)
    assert deadline[6] == pytest.approx(math.log(0.03) / 2 + 1, abs=0.02)


def test_the_controller_by_hand() -> None:
    """Upright at rest: no torque. At .1 and rest, omega should be -.3 after a step: 3 is too little, .8 - .02 short."""
    action = TASK.system.controller(np.array([[0.0, 0.0], [0.1, 0.0], [0.0, 0.0]]), np.array([0, 0, 700]))
    assert action is not None
    # -.3 / .01 = -30 rad/s^2, less 19.6 sin .1 = 1.957: -31.957 * .0375 = -1.198
    assert action == pytest.approx(np.array([[0.0], [-1.2], [3.0]]))
