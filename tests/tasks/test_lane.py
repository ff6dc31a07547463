"""highway-env with RLRom's formula of speed."""

from __future__ import annotations

import importlib

import gymnasium
import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array
from stlbench.simulation.worlds import make_world
from stlbench.task import load_task
from stlbench_methods.flag import Flag

pytest.importorskip("highway_env", reason="the extra field is not installed")
TASK = load_task("lane")


def test_the_source() -> None:
    """G[0,50] F[0,15] speed > 25, and no crash until the last window ends; the road of its configuration."""
    assert TASK.formula == stl.parse("G[0,50] F[0,15] (speed > 25) & G[0,65] (crashed <= 0.5)")
    assert TASK.file.environment is not None
    config = TASK.file.environment.kwargs["config"]
    assert (config["lanes_count"], config["vehicles_density"], config["ego_spacing"]) == (4, 0.75, 2)
    assert config["observation"]["features"] == ["presence", "x", "y", "vx", "vy"]
    assert (TASK.file.steps, TASK.file.sampling_time) == (65, 1)
    assert TASK.actions.axes == ((0, 1, 2, 3, 4),)


def test_the_signals_are_those_of_the_ego_vehicle() -> None:
    importlib.import_module("highway_env")
    assert TASK.file.environment is not None
    environment = gymnasium.make(TASK.file.environment.id, **TASK.file.environment.kwargs)
    environment.reset(seed=5)
    world = make_world(TASK, 1)
    world.restart(np.array([0]), np.array([[5.0]]))
    for action in (3, 0, 3):
        environment.step(action)
        samples = world.advance(np.array([[float(action)]]), 1)
        vehicle = environment.unwrapped.vehicle
        assert samples[-1, 0] == pytest.approx([vehicle.speed, float(vehicle.crashed)])


def drive(speed: Array) -> Array:
    """A trace with these speeds (66,) and no crash."""
    return np.stack([speed, np.zeros(66)], axis=1)[None]


def test_robustness_by_hand() -> None:
    """Fast at one sample of 16; at one of 17; and a crash at the very end. At 25 sharp it is not fast."""
    speed = np.full(66, 20.0)
    speed[15::16] = 25.3
    assert stl.robustness(TASK.formula, drive(speed), TASK.signals) == pytest.approx(0.3)
    crash = drive(speed)
    crash[0, 65, 1] = 1
    assert stl.robustness(TASK.formula, crash, TASK.signals) == pytest.approx(-0.5)
    slow = np.full(66, 20.0)
    slow[16::17] = 30
    assert stl.robustness(TASK.formula, drive(slow), TASK.signals) == pytest.approx(-5)
    assert not stl.satisfied(TASK.formula, drive(np.full(66, 25.0)), TASK.signals).any()


def test_the_rewarded_form_is_the_formula_and_flag_reads_windows() -> None:
    assert Flag(TASK.specification).describe() == {"form": "outer operator over windows", "flags": [16, 16]}
    generator = np.random.default_rng(0)
    traces = np.stack([generator.uniform(22, 26, (200, 66)), generator.random((200, 66)) < 0.005], axis=2)
    both = [stl.satisfied(formula, traces, TASK.signals) for formula in (TASK.formula, TASK.specification.formula)]
    assert np.array_equal(*both)
    assert 0.1 < both[0].mean() < 0.9


def test_the_controller_by_hand() -> None:
    """Nothing ahead: faster. A car 30 m ahead in the own lane, at the same speed: faster; 15 m ahead, and left is free:
    there; with cars on both sides: slower."""
    act = TASK.dynamics.controller  # type: ignore[union-attr]
    ego, none = [1, 0.5, 0.25, 0.3, 0], [0, 0, 0, 0, 0]
    ahead = [1, 15 / 200, 0, 0, 0]
    left, right = [1, 0, -0.25, 0, 0], [1, 0, 0.25, 0, 0]
    assert act(np.array([ego, none]), {}, 0) == (3.0,)
    assert act(np.array([ego, [1, 30 / 200, 0, 0, 0]]), {}, 0) == (3.0,)
    assert act(np.array([ego, ahead, right]), {}, 0) == (0.0,)
    assert act(np.array([ego, ahead, left]), {}, 0) == (2.0,)
    assert act(np.array([ego, ahead, left, right]), {}, 0) == (4.0,)
