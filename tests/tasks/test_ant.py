"""Gymnasium's Ant-v5 that walks to places: tasks whose only code is a controller."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers.controlled_traces import EVERY, beside, satisfying

from stlbench import stl
from stlbench.contract import GymTask
from stlbench.simulation.worlds import make_world
from stlbench.task import load_task

pytest.importorskip("mujoco", reason="the extra mujoco is not installed")
FORMULAS = {
    "ant-goals": "F[0,200] norm(x - 2, y) <= 0.5 & F[200,400] norm(x - 2, y - 2) <= 0.5",
    "ant-patrol": "G[0,400] (F[0,200] norm(x - 1, y) <= 0.5 & F[0,200] norm(x + 1, y) <= 0.5)",
    "ant-avoid": "F[0,300] norm(x - 3, y) <= 0.5 & G[0,300] norm(x - 1.5, y) >= 0.75",
}


def environment(name: str) -> gymnasium.Env[Any, Any]:
    file = load_task(name).file
    assert file.environment is not None
    assert file.environment.id is not None
    return gymnasium.make(file.environment.id, **file.environment.kwargs)


@pytest.mark.parametrize("name", FORMULAS)
def test_the_source(name: str) -> None:
    """The place and 27 entries are seen, each with a name; a step is the environment's."""
    task, env = load_task(name), environment(name)
    assert task.formula == stl.parse(FORMULAS[name])
    assert task.file.steps == stl.horizon(task.formula)
    assert env.unwrapped.dt == task.file.sampling_time  # type: ignore[attr-defined]
    assert env.observation_space.shape == (29,)
    assert task.file.environment is not None
    assert task.file.environment.names is not None
    assert len(task.file.environment.names) == 29
    assert (task.actions.low, task.actions.high) == ((-1,) * 8, (1,) * 8)


def test_the_signals_are_the_models_own() -> None:
    """x and y are the torso's place: entries of MuJoCo's own positions."""
    for signals, data in beside(load_task("ant-goals"), environment("ant-goals")):
        assert signals == pytest.approx(data.qpos[:2])


def test_an_ant_that_falls_or_leaps_has_violated() -> None:
    """It falls under actions that lift it: the verdict is the least robustness within the ranges."""
    task = load_task("ant-goals")
    world = make_world(task, 4)
    world.restart(np.arange(4), np.arange(4.0)[:, None])
    generator = np.random.default_rng(1)
    for _ in range(400):
        world.advance(generator.uniform(-1, 1, (4, 8)), 1)
    assert world.ended.any()
    assert task.file.terminated == "violated"


@pytest.mark.parametrize("turned", [0.0, 1.0])
def test_the_gait_by_hand(turned: float) -> None:
    """At step 0 the way is straight ahead for legs at 45 and -45 degrees: both hips aim at -.56 sin 45 degrees.

    A torque is .68 for a rad off. Leg 4 is on the ground, its ankle aims at 1.02; leg 1 is in the air, at .88. An ant
    that is turned, on its way to a place as seen from it, does the same.
    """
    task = load_task("ant-goals")
    assert isinstance(task.dynamics, GymTask)
    observation = np.zeros(29)
    observation[3], observation[6] = cos(turned / 2), sin(turned / 2)
    observation[:2] = 2 - 2 * cos(turned), -2 * sin(turned)
    torques = task.dynamics.controller(observation, {}, 0)
    assert torques is not None
    hip = -0.68 * 0.56 * sin(pi / 4)
    assert torques[:4] == pytest.approx([hip, 0.68 * 1.02, hip, 0.68 * 0.88])


@EVERY
@pytest.mark.parametrize("name", FORMULAS)
def test_the_controller_satisfies_from_every_start(name: str, every: int) -> None:
    robustness = satisfying(load_task(name), every)
    assert 0 < min(robustness) <= max(robustness) <= 0.5
