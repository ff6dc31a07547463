"""Gymnasium's Hopper-v5 and Walker2d-v5 with formulas of Tang et al. 2025: tasks without code."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from helpers.controlled_traces import beside

from stlbench import stl
from stlbench.contract import Array
from stlbench.simulation.worlds import make_world
from stlbench.task import load_task
from stlbench_methods.flag import Flag

pytest.importorskip("mujoco", reason="the extra mujoco is not installed")
FORMULAS = {
    "hopper": "G[0,985] (F[0,15] v >= 0.5 & z >= 0.7 & abs(angle) <= 1)",
    "walker": "G[0,985] (F[0,15] v >= 0.5 & abs(z - 1.4) <= 0.6 & abs(angle) <= 1)",
}


@pytest.mark.parametrize("name", FORMULAS)
def test_the_source(name: str) -> None:
    task = load_task(name)
    assert task.formula == stl.parse(FORMULAS[name])
    assert task.file.environment is not None
    environment = gymnasium.make(task.file.environment.id, **task.file.environment.kwargs)
    assert environment.spec is not None
    assert environment.spec.max_episode_steps == task.file.steps == stl.horizon(task.formula)
    assert environment.unwrapped.dt == task.file.sampling_time
    assert isinstance(environment.action_space, gymnasium.spaces.Box)
    assert (task.actions.low, task.actions.high) == ((-1,) * len(task.actions.low), (1,) * len(task.actions.low))
    assert environment.action_space.shape == (len(task.actions.low),)


@pytest.mark.parametrize("name", FORMULAS)
def test_the_signals_are_the_models_own(name: str) -> None:
    """v is the torso's velocity, z its height and angle its lean: entries of MuJoCo's own positions and velocities."""
    task = load_task(name)
    assert task.file.environment is not None
    environment = gymnasium.make(task.file.environment.id, **task.file.environment.kwargs)
    for signals, data in beside(task, environment):
        assert signals == pytest.approx([data.qvel[0], data.qpos[1], data.qpos[2]])


@pytest.mark.parametrize("name", FORMULAS)
def test_what_the_environment_terminates_has_violated_the_formula(name: str) -> None:
    """Under random actions the robot falls; its last sample is outside of what the formula allows."""
    task = load_task(name)
    world = make_world(task, 8)
    world.restart(np.arange(8), np.arange(8.0)[:, None])
    generator = np.random.default_rng(1)
    for _ in range(300):
        world.advance(generator.uniform(-1, 1, (8, len(task.actions.low))), 1)
    assert world.ended.all()
    trace = np.repeat(world.signals[:, None], 1001, axis=1)
    safe = stl.parse(FORMULAS[name].replace("F[0,15] v >= 0.5 & ", ""))
    assert not stl.satisfied(safe, trace, task.signals).any()


def going(name: str, v: Array) -> Array:
    """A trace with these speeds (1001,), upright and at a good height."""
    height = {"hopper": 1.2, "walker": 1.3}[name]
    return np.stack([v, np.full(1001, height), np.full(1001, 0.1)], axis=1)[None]


@pytest.mark.parametrize("name", FORMULAS)
def test_robustness_by_hand(name: str) -> None:
    """Fast at one sample of 16: .2 more than enough; at one of 17: a window without it."""
    task = load_task(name)
    v = np.zeros(1001)
    v[15::16] = 0.7
    assert stl.robustness(task.formula, going(name, v), task.signals) == pytest.approx(0.2)
    v = np.zeros(1001)
    v[16::17] = 0.7
    assert stl.robustness(task.formula, going(name, v), task.signals) == pytest.approx(-0.5)


@pytest.mark.parametrize("name", FORMULAS)
def test_flag_reads_windows(name: str) -> None:
    assert Flag(load_task(name).specification).describe() == {"form": "outer operator over windows", "flags": [16, 1]}
