"""Gymnasium's Walker2d-v5 whose speed returns to a band: a task whose only code is a controller."""

from __future__ import annotations

from math import sin

import gymnasium
import numpy as np
import pytest
from helpers.controlled_traces import EVERY, beside, satisfying

from stlbench import stl
from stlbench.contract import Array, GymTask
from stlbench.task import load_task

pytest.importorskip("mujoco", reason="the extra mujoco is not installed")
TASK = load_task("walker-band")


def test_the_source() -> None:
    traces = np.random.default_rng(0).uniform([0, 0.9, -0.9], [2, 1.9, 0.9], (20, 401, 3))
    written = stl.parse(
        "G[0,300] F[0,100] (v >= 0.75 & v <= 1.25) & G[0,400] (z >= 0.8 & z <= 2 & angle <= 1 & angle >= -1)"
    )
    one, other = (stl.robustness(each, traces, TASK.signals) for each in (TASK.formula, written))
    assert one == pytest.approx(other)
    assert TASK.file.steps == stl.horizon(TASK.formula) == 400
    env = gymnasium.make("Walker2d-v5")
    assert env.unwrapped.dt == TASK.file.sampling_time  # type: ignore[attr-defined]
    assert (TASK.actions.low, TASK.actions.high) == ((-1,) * 6, (1,) * 6)
    assert TASK.file.terminated == "violated"


def test_the_signals_are_the_models_own() -> None:
    """v is the torso's velocity, z its height and angle its lean: entries of MuJoCo's own velocities and positions."""
    for signals, data in beside(TASK, gymnasium.make("Walker2d-v5")):
        assert signals == pytest.approx([data.qvel[0], data.qpos[1], data.qpos[2]])


def walking(v: Array) -> Array:
    """A trace with these speeds (401,), upright."""
    return np.stack([v, np.full(401, 1.3), np.zeros(401)], axis=1)


def test_robustness_by_hand() -> None:
    """1.1 m/s is .15 within the band. A walker that runs from step 150 on was in it, and never comes back.

    One that is at 1.05 m/s each 100 steps satisfies by .2, each 102 steps not: a window has 101 samples.
    """
    v = np.full(401, 1.1)
    assert stl.robustness(TASK.formula, walking(v), TASK.signals) == pytest.approx(0.15)
    v[150:] = 2.0
    assert stl.robustness(TASK.formula, walking(v), TASK.signals) == pytest.approx(-0.75)
    for every, expected in ((100, 0.2), (102, -0.75)):
        v[:] = np.where(np.arange(401) % every == 0, 1.05, 2.0)
        assert stl.robustness(TASK.formula, walking(v), TASK.signals) == pytest.approx(expected)


def test_the_gait_by_hand() -> None:
    """At step 0, at the band's middle and upright, the thigh aims at its middle and its swing times the sine of its
    phase; the left thigh's swing has the other sign.
    """
    assert isinstance(TASK.dynamics, GymTask)
    observation = np.zeros(17)
    observation[8] = 1.0
    observation[2] = observation[5] = 0.528 - 0.2
    torques = TASK.dynamics.controller(observation, {}, 0)
    assert torques is not None
    swing = -0.641 * sin(-1.468)
    assert torques[0] == pytest.approx(min(1.0, 2.883 * (swing + 0.2)))
    assert torques[3] == pytest.approx(max(-1.0, 2.883 * (-swing + 0.2)))
    observation[1], observation[10], observation[8] = 0.1, 0.2, 0.9
    aim = 0.2 + swing + 0.1 * -0.4 + 0.2 * -0.121 - 0.1 * -0.142
    observation[2] += aim - 0.1  # so that the torque is within its ends
    turned = TASK.dynamics.controller(observation, {}, 0)
    assert turned is not None
    assert turned[0] == pytest.approx(2.883 * 0.1)


@EVERY
def test_the_controller_satisfies_from_every_start(every: int) -> None:
    robustness = satisfying(TASK, every)
    assert 0.1 < min(robustness) <= max(robustness) <= 0.25
