"""Gymnasium's HalfCheetah-v5 whose speed returns to a band: a task whose only code is a controller."""

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
TASK = load_task("cheetah-band")


def test_the_source() -> None:
    traces = np.random.default_rng(0).uniform([1, -0.9], [4, 0.9], (20, 201, 2))
    written = stl.parse("G[0,150] F[0,50] (v >= 2 & v <= 3) & G[0,200] (angle <= 1 & angle >= -1)")
    one, other = (stl.robustness(each, traces, TASK.signals) for each in (TASK.formula, written))
    assert one == pytest.approx(other)
    assert TASK.file.steps == stl.horizon(TASK.formula) == 200
    env = gymnasium.make("HalfCheetah-v5")
    assert env.unwrapped.dt == TASK.file.sampling_time  # type: ignore[attr-defined]
    assert (TASK.actions.low, TASK.actions.high) == ((-1,) * 6, (1,) * 6)


def test_the_signals_are_the_models_own() -> None:
    """v is the torso's velocity and angle its lean: entries of MuJoCo's own velocities and positions."""
    for signals, data in beside(TASK, gymnasium.make("HalfCheetah-v5")):
        assert signals == pytest.approx([data.qvel[0], data.qpos[2]])


def running(v: Array) -> Array:
    """A trace with these speeds (201,), upright."""
    return np.stack([v, np.zeros(201)], axis=1)


def test_robustness_by_hand() -> None:
    """2.7 m/s is .3 within the band. A cheetah that is faster from step 60 on was in it, and never comes back."""
    v = np.full(201, 2.7)
    assert stl.robustness(TASK.formula, running(v), TASK.signals) == pytest.approx(0.3)
    v[60:] = 5.0
    assert stl.robustness(TASK.formula, running(v), TASK.signals) == pytest.approx(-2.0)
    v[60:] = np.where(np.arange(141) % 50 == 49, 2.1, 5.0)
    assert stl.robustness(TASK.formula, running(v), TASK.signals) == pytest.approx(0.1)


def test_the_gait_by_hand() -> None:
    """At step 0 the back thigh aims at its middle and its swing times the sine of its phase."""
    assert isinstance(TASK.dynamics, GymTask)
    observation = np.zeros(17)
    observation[2] = 0.1
    torques = TASK.dynamics.controller(observation, {}, 0)
    assert torques is not None
    assert torques[0] == pytest.approx(0.763 * (-0.355 + 0.26 * sin(4.834) - 0.1))


@EVERY
def test_the_controller_satisfies_from_every_start(every: int) -> None:
    robustness = satisfying(TASK, every)
    assert 0.4 < min(robustness) <= max(robustness) <= 0.5
