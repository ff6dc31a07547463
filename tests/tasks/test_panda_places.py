"""The seven joints of a Panda: its kinematics by hand, and the formula of its task."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench import stl
from stlbench.task import load_task
from stlbench_tasks.panda_places import chain

TASK = load_task("panda-places")
REST = np.array([0, -1, 0, -3, 0, 2, 1]) * np.pi / 4


def test_the_flange_by_hand() -> None:
    """Upright, the flange points down: x = .088, z = .333 + .316 + .384 - .107.

    With the elbow bent by 90 degrees the forearm lies along x: .0825 + .384 + .107 ahead of the elbow, whose axis is at
    .0825, .333 + .316, and .0825 above that; the wrist's .088 leads up, as it is turned by half a turn.
    """
    upright, bent = np.zeros(7), np.array([0, 0, 0, -np.pi / 2, 0, np.pi, 0])
    assert chain(upright)[0] == pytest.approx([0.088, 0, 0.926])
    assert chain(bent)[0] == pytest.approx([0.0825 + 0.384 + 0.107, 0, 0.649 + 0.0825 + 0.088], abs=1e-9)
    assert chain(REST)[0] == pytest.approx([0.3069, 0, 0.5903], abs=1e-4)


def test_the_first_joint_turns_all_about_the_vertical() -> None:
    turned = REST + np.eye(7)[0] / 2
    x, z = chain(REST)[0][[0, 2]]
    assert chain(turned)[0] == pytest.approx([x * np.cos(0.5), x * np.sin(0.5), z])


def test_axes_and_ways_give_the_flange_s_motion() -> None:
    """A joint that turns moves the flange by axis times way; the last joint turns it about itself."""
    angles = np.random.default_rng(0).uniform(-1, 1, 7)
    place, axes, ways = chain(angles)
    moved = np.array([(chain(angles + 1e-6 * one)[0] - place) / 1e-6 for one in np.eye(7)])
    assert moved == pytest.approx(np.cross(axes, ways), abs=1e-5)
    assert moved[6] == pytest.approx(np.zeros(3), abs=1e-9)


def test_joints_turn_and_stop_at_their_ends() -> None:
    states = np.array([REST, REST])
    actions = np.array([[1.0, -2, 0, 0, 0, 0, 0.5], [0, 0, 0, 2.175, 0, 0, 0]])
    after = TASK.system.step(states, actions)
    assert after[0] == pytest.approx(REST + 0.05 * actions[0])
    for _ in range(40):
        after = TASK.system.step(after, actions)
    assert after[1, 3] == -0.0698
    assert after[0, 1] == -1.7628


def test_robustness_by_hand() -> None:
    """At both places .02 m off: .04. A flange that comes down on the column by .1 m is that deep in it."""
    trace = np.empty((161, 3))
    trace[:60], trace[60:] = (0.45, 0.4, 0.37), (0.45, -0.38, 0.35)
    assert stl.horizon(TASK.formula) == TASK.file.steps == 160
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(0.04)
    trace[70] = 0.45, 0.0, 0.3
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(-0.1)
    trace[70] = 0.45, 0.0, 0.42
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(0.02)


def test_the_way_by_hand_moves_straight_to_its_aim() -> None:
    """Far from a singular pose the flange moves along the way to its aim, at half a metre a second at most."""
    for angles, t, aim in ((REST, 0, [0.45, 0.4, 0.35]), (REST, 100, [0.45, -0.1, 0.75])):
        speeds = TASK.system.controller(angles[None], np.array([t]))
        place, axes, ways = chain(angles)
        motion, way = speeds[0] @ np.cross(axes, ways), np.array(aim) - place
        assert motion @ way / np.linalg.norm(motion) / np.linalg.norm(way) > 0.99
        assert 0.4 < np.linalg.norm(motion) <= 0.5
