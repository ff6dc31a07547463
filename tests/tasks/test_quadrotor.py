"""The quadrotor in space: its motion by hand, and the formulas of its two tasks."""

from __future__ import annotations

from math import atan2, cos, pi, sin

import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array
from stlbench.task import load_task
from stlbench_tasks.quadrotor_in_space import GRAVITY, INERTIA, MASS

TASK = load_task("quadrotor-gates")
SYSTEM, DT = TASK.system, 0.02
WEIGHT = MASS * GRAVITY
PLACE, VELOCITY, ANGLES, RATES = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)


def body(**columns: float) -> Array:
    """A state (1, 12) of zeros but for some columns."""
    return np.array([[columns.get(name, 0.0) for name in SYSTEM.state]])


def after(state: Array, steps: int, *action: float) -> Array:
    """The state (12,) after so many steps of one action."""
    for _ in range(steps):
        state = SYSTEM.step(state, np.array([action]))
    found: Array = state[0]
    return found


def test_the_formulas() -> None:
    gates = [(2, 1, 1.5), (4, -1, 2.5), (6, 0, 1.5)]
    windows = [(0, 130), (130, 260), (260, 400)]
    text = " & ".join(
        f"F[{a},{b}] norm(x - {x}, y - {y}, z - {z}) <= 0.4" for (a, b), (x, y, z) in zip(windows, gates, strict=True)
    )
    traces = np.random.default_rng(0).uniform([-2, -4, -1, 0], [8, 4, 5, 1], (20, 401, 4))
    written = stl.parse(f"{text} & G[0,400] tilt <= 0.6 & G[0,400] z >= 0.3")
    one, other = (stl.robustness(each, traces, TASK.signals) for each in (TASK.formula, written))
    assert one == pytest.approx(other)
    assert (TASK.file.sampling_time, TASK.file.steps) == (DT, 400)


def test_the_formula_of_the_patrol() -> None:
    """Safety in each window of 250 steps, from each of the steps 0 to 300, is safety up to step 550."""
    patrol = load_task("quadrotor-patrol")
    assert type(patrol.system).step is type(SYSTEM).step
    assert stl.horizon(patrol.formula) == patrol.file.steps == 550
    traces = np.random.default_rng(0).uniform([-2, -1, -1, 0], [2, 2, 5, 1], (20, 551, 4))
    places = "F[0,250] norm(x - 1, y, z - 1.5) <= 0.4 & F[0,250] norm(x + 1, y - 1, z - 2) <= 0.4"
    written = stl.parse(f"G[0,300] ({places}) & G[0,550] (tilt <= 0.6 & z >= 0.3)")
    one, other = (stl.robustness(each, traces, TASK.signals) for each in (patrol.formula, written))
    assert one == pytest.approx(other)


def test_the_actions_are_about_the_weight() -> None:
    """Thrust is at most twice the weight, a torque turns by about 10 and, upright, by 2 rad/s^2."""
    thrust, *torques = TASK.actions.high
    assert thrust == pytest.approx(2 * WEIGHT, abs=0.01)
    assert np.array(torques) / INERTIA == pytest.approx([10.3, 10.3, 2.27], abs=0.01)


def test_hover_stays() -> None:
    state = body(x=1, y=-2, z=3, yaw=0.7)
    assert after(state, 500, WEIGHT, 0, 0, 0) == pytest.approx(state[0], abs=1e-9)


def test_free_fall_is_exact() -> None:
    """Without thrust: x + v t, z + v t - g t^2 / 2, whatever the robot's angles; the energy stays."""
    state = body(x=1, z=3, v_x=2, v_z=4, roll=0.4, pitch=-0.3, yaw=2)
    fallen = after(state, 100, 0, 0, 0, 0)
    t = 100 * DT
    assert fallen[PLACE] == pytest.approx([1 + 2 * t, 0, 3 + 4 * t - GRAVITY * t**2 / 2])
    assert fallen[VELOCITY] == pytest.approx([2, 0, 4 - GRAVITY * t])
    energies = [GRAVITY * each[2] + (each[VELOCITY] ** 2).sum() / 2 for each in (state[0], fallen)]
    assert energies[0] == pytest.approx(energies[1])


@pytest.mark.parametrize(
    ("leaning", "direction"),
    [
        ({"pitch": 0.1}, (sin(0.1), 0)),  # nose down: ahead
        ({"roll": 0.1}, (0, -sin(0.1))),  # to the right, which is -y
        ({"pitch": 0.1, "yaw": pi / 2}, (0, sin(0.1))),
        ({"roll": 0.1, "yaw": pi / 2}, (sin(0.1), 0)),
    ],
)
def test_thrust_pushes_along_the_body_s_own_axis(leaning: dict[str, float], direction: tuple[float, float]) -> None:
    """At a thrust of the weight the acceleration is g (sin, 0, cos - 1) in the direction in which it leans."""
    moved = after(body(**leaning), 1, WEIGHT, 0, 0, 0)
    expected = GRAVITY * np.array([*direction, cos(0.1) - 1])
    assert moved[VELOCITY] == pytest.approx(DT * expected)
    assert moved[PLACE] == pytest.approx(DT**2 / 2 * expected)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_torque_about_one_axis_turns_evenly(axis: int) -> None:
    """From rest, rate = a t and angle = a t^2 / 2, exactly, since the mean of both rates counts."""
    torques = np.zeros(3)
    torques[axis] = 0.004
    turned = after(body(), 20, WEIGHT, *torques)
    turning, t = 0.004 / INERTIA[axis], 20 * DT
    rates, angles = np.zeros(3), np.zeros(3)
    rates[axis], angles[axis] = turning * t, turning * t**2 / 2
    assert turned[RATES] == pytest.approx(rates)
    assert turned[ANGLES] == pytest.approx(angles)


def test_a_body_that_spins_about_two_axes_turns_the_third() -> None:
    """Euler: I_y q' = (I_z - I_x) p r. With p = r = 1 that is (8.801 - 4.856) / 4.856 rad/s^2; p' = r' = 0 at q = 0."""
    turned = after(body(p=1, r=1), 1, 0, 0, 0, 0)
    assert turned[RATES] == pytest.approx([1, DT * (8.801 - 4.856) / 4.856, 1])


def rotation(angles: Array) -> Array:
    """Rz(yaw) Ry(pitch) Rx(roll): (3,) -> (3, 3)."""
    (c, d, e), (s, t, u) = np.cos(angles), np.sin(angles)
    about_x = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    about_y = np.array([[d, 0, t], [0, 1, 0], [-t, 0, d]])
    found: Array = np.array([[e, -u, 0], [u, e, 0], [0, 0, 1]]) @ about_y @ about_x
    return found


def test_rates_turn_the_body_s_axes() -> None:
    """The derivative of the rotation R is R [rates]x, at any angles: compared with a step that is short."""
    angles, rates = np.array([0.5, -0.7, 1.9]), np.array([0.3, -0.8, 0.6])
    short = type(SYSTEM)(1e-6)
    state = np.concatenate([np.zeros(6), angles, rates])[None]
    turned = short.step(state, np.zeros((1, 4)))[0]
    p, q, r = rates
    crossed = np.array([[0, -r, q], [r, 0, -p], [-q, p, 0]])
    assert (rotation(turned[ANGLES]) - rotation(angles)) / 1e-6 == pytest.approx(rotation(angles) @ crossed, abs=1e-5)
    pushed = short.step(state, np.array([[MASS, 0, 0, 0]]))[0, VELOCITY] / 1e-6
    assert pushed == pytest.approx(rotation(angles)[:, 2] - [0, 0, GRAVITY])


def test_tilt_is_the_angle_to_the_vertical() -> None:
    states = np.concatenate(
        [body(z=2), body(pitch=0.4, yaw=1), body(roll=-0.4), body(roll=pi), body(roll=0.3, pitch=0.4)]
    )
    assert SYSTEM.signals(states)[:, 3] == pytest.approx([0, 0.4, 0.4, pi, np.arccos(cos(0.3) * cos(0.4))])


def test_numbers_stay_finite_on_edge() -> None:
    edge = after(body(pitch=pi / 2, p=5, q=-5, r=5), 400, 9.18, 0.05, 0.05, 0.02)
    assert np.isfinite(edge).all()


def test_the_scaled_state_by_hand() -> None:
    state = body(x=4, y=-2, z=2, v_x=1, v_y=-2, v_z=0.5, roll=pi / 6, pitch=0, yaw=atan2(4, 3), p=1, q=-2, r=0.5)
    (seen,) = SYSTEM.scaled_state(state)
    angles = [cos(pi / 6), 1, 0.6, 0.5, 0, 0.8]
    assert seen == pytest.approx([1, -0.5, 0.5, 0.5, -1, 0.25, *angles, 0.5, -1, 0.25])
