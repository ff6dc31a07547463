"""The ball-in-cup of the DeepMind control suite, sec. IV of the paper."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.mujoco_task import rollout

from stlbench import stl
from stlbench.contract import Array
from stlbench.task import load_task, starts

TASK = load_task("ball-in-cup")


def test_robustness_by_hand() -> None:
    """Places as 3, 4, 5: in the cup, 0.08 from it; apart by 0.25; in the cup again, 0.05 from it."""
    places = np.zeros((1, 1001, 14))
    for place, begin, end in (((0.048, -0.064), 0, 401), ((0.15, -0.2), 401, 701), ((-0.03, -0.04), 701, 1001)):
        places[0, begin:end, -2:] = place
    trace = TASK.system.signals(places)
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(0.02)
    trace[0, 600] = 0.2
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(0)
    trace[0, 600] = 0.15
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(-0.05)


@pytest.mark.parametrize("ball", [(-0.15, 0.45), (0.0, 0.56)])
def test_steps_are_those_of_the_suite_bit_for_bit(ball: tuple[float, float], monkeypatch: pytest.MonkeyPatch) -> None:
    """From a ball beside the cup, on a string that becomes taut, and from one in it, which it touches."""
    monkeypatch.setenv("MUJOCO_GL", "disable")
    from dm_control import suite

    environment = suite.load("ball_in_cup", "catch", task_kwargs={"random": 0})
    environment.reset()
    physics, data = environment.physics, environment.physics.data
    with physics.reset_context():
        data.qpos[2:] = ball[0], ball[1] - 0.2
    actions = np.random.default_rng(0).uniform(-1, 1, (200, 2))
    for action, state in zip(actions, rollout(TASK, start(*ball), actions), strict=True):
        environment.step(action)
        assert np.array_equal(state[:8], np.concatenate([data.qpos, data.qvel]))
        difference = physics.named.data.xpos["ball", ["x", "z"]] - physics.named.data.xpos["cup", ["x", "z"]]
        assert np.array_equal(state[-2:], difference)


def start(x: float, z: float) -> Array:
    state: Array = TASK.system.initial_states(np.array([[x, z]]))[0]
    return state


def test_starts_are_the_suites_but_for_the_corners_of_the_cup(monkeypatch: pytest.MonkeyPatch) -> None:
    """No start touches anything; of the places that touch nothing at most 1 of 20 is left out."""
    monkeypatch.setenv("MUJOCO_GL", "disable")
    from dm_control import suite

    physics = suite.load("ball_in_cup", "catch").physics
    region = TASK.file.initial
    assert (region.low.tolist(), region.high.tolist()) == ([-0.2, 0.4], [0.2, 0.7])
    points = np.random.default_rng(0).uniform(region.low, region.high, (2000, 2))
    points = np.concatenate([starts.grid(region, 500), points])
    touches = np.empty(len(points), dtype=np.bool_)
    for i, point in enumerate(points):
        with physics.reset_context():
            physics.data.qpos[2:] = point - [0, 0.2]
        touches[i] = physics.data.ncon > 0
    assert not touches[:500].any()
    free = points[500:][~touches[500:]]
    assert 0.95 < len(region.keep(free)) / len(free) < 1


def test_a_start_is_the_balls_place_above_the_ground() -> None:
    """The middle of the cup's rim is 0.6 above the ground."""
    state = start(-0.1, 0.45)
    assert state[-2:] == pytest.approx([-0.1, -0.15])
    assert state[:8] == pytest.approx([0, 0, -0.1, 0.25, 0, 0, 0, 0])
