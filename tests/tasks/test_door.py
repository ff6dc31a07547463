"""The Adroit hand of Gymnasium-Robotics that opens a door: a task whose only code is a controller."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from helpers.controlled_traces import beside

from stlbench import stl
from stlbench.contract import GymTask
from stlbench.simulation import baselines, referee
from stlbench.task import load_task

pytest.importorskip("gymnasium_robotics", reason="the extra mujoco is not installed")
TASK = load_task("door")


def environment() -> gymnasium.Env[Any, Any]:
    return gymnasium.make("gymnasium_robotics:AdroitHandDoor-v1")


def test_the_source() -> None:
    """The formula asks for what the environment calls a success, and to keep it."""
    env = environment()
    assert env.unwrapped.dt == TASK.file.sampling_time  # type: ignore[attr-defined]
    assert TASK.file.steps == stl.horizon(TASK.formula) == 240
    env.reset(seed=0)
    env.unwrapped.data.qpos[-2] = 1.36  # type: ignore[attr-defined]
    assert env.step(env.action_space.sample() * 0)[4]["success"]
    assert (TASK.actions.low, TASK.actions.high) == ((-1,) * 28, (1,) * 28)
    assert TASK.formula == stl.parse("F[0,200] G[0,40] door >= 1.35")


def test_the_signals_are_the_models_own() -> None:
    """Door and latch are the angles of the last two of MuJoCo's joints."""
    for signals, data in beside(TASK, environment()):
        assert signals == pytest.approx(data.qpos[-2:])


def test_robustness_by_hand() -> None:
    """Open by 1.5 rad from step 100 to 140: .15. A step less, or a door that falls to, does not count."""
    trace = np.zeros((241, 2))
    trace[100:141, 0] = 1.5
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(0.15)
    trace[140, 0] = 1.2
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(-0.15)


def test_a_start_is_where_the_door_stands() -> None:
    """It is drawn from 0.1 m along each axis; the handle is with it."""
    seeds = TASK.starts.report_and_selection()[0]
    env = environment()
    handles = np.array([env.reset(seed=int(seed))[0][32:35] for (seed,) in seeds])
    assert (np.ptp(handles, axis=0) > 0.04).all()
    assert (np.ptp(handles, axis=0) <= 0.1).all()


def test_a_door_without_a_turned_latch_stays_shut() -> None:
    """A pull at the handle alone opens it by less than 0.1 rad: the latch is behind the frame."""
    env = environment()
    env.reset(seed=0)
    data = env.unwrapped.data  # type: ignore[attr-defined]
    opened = []
    for turned in (0.0, 1.6):
        env.reset(seed=0)
        data.qpos[-1] = turned
        data.qfrc_applied[-2] = 30
        for _ in range(100):
            env.step(env.action_space.sample() * 0)
        opened.append(data.qpos[-2])
        data.qfrc_applied[-2] = 0
    assert opened[0] < 0.1
    assert opened[1] > 1.2


def test_the_poses_by_hand() -> None:
    """At step 0, with a latch 0.3 m high and shut, the palm at the first pose's place asks the arm for no way."""
    from stlbench_tasks.door import _POSES

    assert isinstance(TASK.dynamics, GymTask)
    observation = np.zeros(39)
    observation[32:35] = 0.05, 0.12, 0.3
    observation[29:32] = observation[32:35] + _POSES[0, :3]
    actions = TASK.dynamics.controller(observation, {}, 0)
    assert actions is not None
    pushed = observation[30] + 0.2
    assert actions[0] == pytest.approx(np.clip((0.4 * pushed - 0.1) / 0.4, -1, 1))
    assert actions[1:3] == pytest.approx([0, 0])
    observation[31] -= 0.01  # 1 cm low: the arm turns by -0.02 rad, of which 0.4 are asked for
    lower = TASK.dynamics.controller(observation, {}, 0)
    assert lower is not None
    assert lower[1] == pytest.approx(-0.4 * 0.02 / 0.75)


@pytest.mark.parametrize("every", [pytest.param(1, marks=pytest.mark.slow), 4], ids=["all", "some"])
def test_the_controller_opens_the_door(every: int) -> None:
    """Contact is sensitive: it satisfies from all starts of the report, and misses some others."""
    episodes = baselines.record_controller(TASK, TASK.starts.report_and_selection()[0][::every])
    assert episodes is not None
    score = referee.score(TASK, episodes.traces, lasted=episodes.lasted)
    assert score.satisfaction >= 0.75  # a processor with other rounding may miss one too
    assert max(score.robustness) < 0.25
    if every == 1:
        assert TASK.file.best_known is not None
        assert score.mean == pytest.approx(TASK.file.best_known.robustness, abs=1.1e-5)
