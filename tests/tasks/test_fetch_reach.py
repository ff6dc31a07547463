"""The Fetch arm of Gymnasium-Robotics, sec. IV of the paper."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench import stl
from stlbench.task import load_task

TASK = load_task("fetch-reach")


def test_robustness_by_hand() -> None:
    """0.03, 0.04 and 0 off the first point; 0.02, 0.03 and 0.06 off the second."""
    trace = np.empty((1, 201, 3))
    trace[0, :120], trace[0, 120:] = (1.53, 0.47, 0.47), (1.48, 1.08, 0.53)
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(0.03)  # the least of 0.05 and 0.03
    trace[0, 100, 2] = 0.59  # 3-4-12: 0.13 off
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(-0.03)


def test_steps_are_those_of_the_environment_bit_for_bit() -> None:
    """From its reset, with all four actions, of which the last does nothing."""
    from gymnasium_robotics.envs.fetch.reach import MujocoFetchReachEnv

    environment = MujocoFetchReachEnv()
    observation, _ = environment.reset(seed=0)
    # `initial_states` adds idle steps to the reset; the environment takes them too
    state = TASK.system.initial_states(np.zeros((1, 4)))
    for _ in range(4):
        observation, *_ = environment.step(np.zeros(4))
    for action in np.random.default_rng(0).uniform(-1, 1, (200, 4)):
        assert np.array_equal(state[0, :15], environment.data.qpos)
        assert np.array_equal(state[0, 15:30], environment.data.qvel)
        assert np.array_equal(TASK.system.signals(state)[0], observation["observation"][:3])
        assert state[0, 48:] * 0.04 == pytest.approx(observation["observation"][5:8], abs=1e-9)
        observation, *_ = environment.step(action)
        state = TASK.system.step(state, action[None, :3])


def test_what_is_left_out_of_a_step_changes_no_bit() -> None:
    """The environment ends a step with all of `mj_forward`; where the gripper is and how it moves needs a part."""

    class Whole(type(TASK.system)):  # type: ignore[misc]
        def arrive(self) -> None:
            self.data.qpos[-2:] = 0
            self.mujoco.mj_forward(self.model, self.data)

    part, whole = TASK.system, Whole(TASK.file.sampling_time)
    ours = theirs = part.initial_states(np.array([[1, 0, 0, 3.0], [0.3, -1, -1, 5.0]]))
    for action in np.random.default_rng(1).uniform(-1, 1, (60, 2, 3)):
        ours, theirs = part.step(ours, np.sign(action)), whole.step(theirs, np.sign(action))
        assert np.array_equal(ours, theirs)


def test_starts_are_where_a_repeated_action_leads() -> None:
    """From the reset near (1.34, 0.75, 0.53), and the gripper comes to rest; `moves` is rounded down, at most 5."""
    points = np.array([[1, 0, 0, 0.9], [1, 0, 0, 3.0], [1, 0, 0, 3.9], [0, -1, 0.5, 5.0], [0, -1, 0.5, 6.0]])
    states = TASK.system.initial_states(points)
    x, y, z = TASK.system.signals(states).T
    assert (x[0], y[0], z[0]) == pytest.approx((1.34, 0.75, 0.53), abs=0.01)
    assert np.array_equal(states[1], states[2])
    assert np.array_equal(states[3], states[4])
    assert 0.05 < x[1] - x[0] < 0.16
    assert 0.1 < y[0] - y[3] < 0.26
    assert 0.05 < z[3] - z[0] < 0.13
    speeds = np.linalg.norm(states[:, 48:], axis=1)
    assert speeds.max() < 0.1  # an action of 1 moves it at up to 1.25 m/s
