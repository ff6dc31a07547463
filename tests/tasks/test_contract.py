"""What all tasks that come with stlbench have in common: their controllers, their robots."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.controlled_traces import all_starts, trace

from stlbench import stl
from stlbench.simulation import referee
from stlbench.task import load_task
from stlbench_tasks.differential_drive import DifferentialDrive

MUJOCO = ("ball-in-cup", "cartpole", "fetch-avoid", "fetch-reach")


CONTROLLED = {
    "annulus": (1.45, 1.5),
    "ball-in-cup": (0.02, 0.033),  # a ball at rest in the cup is 0.068 below its rim, which leaves 0.032
    "cartpole": (0.099, 0.1),
    "cartpole-steady": (0.03, 0.1),
    "dwell": (0.4, 0.5),
    "fetch-avoid": (0.025, 0.05),
    "fetch-reach": (0.085, 0.1),
    "linear-chain": (0.07, 0.4),
    "overlap": (0.19, 0.25),  # the passages are 0.5 m wide; a start at (1.3, 1) has 0.2
    "panda-places": (0.01, 0.06),
    "patrol": (0.25, 0.5),
    "pendulum": (0.035, 0.05),  # a torque's step leaves omega up to 0.0133 off: 0.05 - 0.0133 - 0.0003
    "quadrotor-gates": (0.2, 0.4),
    "quadrotor-patrol": (0.3, 0.4),
    "reach-stay": (0.95, 1.0),
    "robot-nav": (1.95, 2.0),
    "unicycle-choice": (0.39, 0.4),
    "zones": (0.15, 0.4),
}
"""Task -> what its controller reaches from every start at least, and the most that the formula allows."""


@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 16], ids=["all", "some"])
@pytest.mark.parametrize("name", CONTROLLED)
def test_the_controller_satisfies_from_every_start(name: str, every: int) -> None:
    if name in MUJOCO:
        pytest.importorskip("mujoco", reason="an extra is not installed")
    task, (least, most) = load_task(name), CONTROLLED[name]
    score = referee.score(task, trace(task, all_starts(task)[::every]))
    assert all(score.satisfied)
    assert least < min(score.robustness) <= max(score.robustness) <= most + 1e-9


@pytest.mark.parametrize("name", ["annulus", "hold-disc", "hold-disc-coarse", "overlap", "reach-stay", "robot-nav"])
def test_a_robot_moves_along_its_heading_and_sees_its_room_from_minus_1_to_1(name: str) -> None:
    """x' = x + dt v cos, y' = y + dt v sin, heading' = heading + dt omega; 3-4-5: cos = .6, sin = .8."""
    task, turn = load_task(name), math.atan2(4, 3)
    assert isinstance(task.system, DifferentialDrive)
    dt, high = task.file.sampling_time, np.array(task.actions.high)
    v, omega = high
    state = np.array([[1.0, 2.0, turn], [1.0, 2.0, math.pi / 2], [1.0, 2.0, 0.0]])
    after = task.system.step(state, np.array([high, -high / 2, [v, 0]]))
    expected = [[0.6 * v, 0.8 * v, omega], [0, -v / 2, -omega / 2], [v, 0, 0]]
    assert after == pytest.approx(state + dt * np.array(expected))
    assert task.system.signals(state).tolist() == state[:, :2].tolist()
    ends = np.array([[*task.specification.low, 0.0], [*task.specification.high, np.pi / 2]])
    assert task.system.scaled_state(ends) == pytest.approx(np.array([[-1, -1, 1, 0], [1, 1, 0, 1]]))


@pytest.mark.parametrize("name", ["annulus", "hold-disc", "hold-disc-coarse"])
def test_the_nested_form_is_the_formula(name: str) -> None:
    """It reads the same samples: random walks, which go farthest at their ends, have the same robustness."""
    task = load_task(name)
    nested, low, high = task.specification.nested, np.array(task.specification.low), np.array(task.specification.high)
    assert nested is not None
    assert nested != task.formula
    steps = np.random.default_rng(0).normal(size=(200, task.file.steps + 1, 2), scale=(high - low) / 300)
    traces = (low + high) / 2 + np.cumsum(steps, axis=1)
    formula, other = (stl.robustness(each, traces, task.signals) for each in (task.formula, nested))
    assert np.array_equal(formula, other)
    assert np.ptp(formula) > 0
