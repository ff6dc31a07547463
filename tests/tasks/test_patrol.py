"""The noisy unicycle that visits two regions again and again (Ikemoto, Ushio 2022)."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.controlled_traces import all_starts
from scipy import stats

from stlbench import stl
from stlbench.contract import Array, Model, Unsuitable
from stlbench.task import build_method, load_task
from stlbench_planning.grid import axes_of
from stlbench_tasks.noisy_unicycle import NoisyUnicycle

TASK = load_task("patrol")
A, B = ("x >= 3.5 & x <= 4.5 & y >= 3.5 & y <= 4.5", "x >= 3.5 & x <= 4.5 & y >= 1.5 & y <= 2.5")


def test_the_source() -> None:
    """A = [3.5,4.5]^2, B = [3.5,4.5] x [1.5,2.5], G[0,900] (F[0,99] A & F[0,99] B), and the robot's numbers."""
    traces = np.random.default_rng(0).uniform(1.4, 4.6, (20, 1001, 2))
    written = stl.parse(f"G[0,900] (F[0,99] ({A}) & F[0,99] ({B}))")
    both = [stl.robustness(formula, traces, TASK.signals) for formula in (TASK.formula, written)]
    assert both[0] == pytest.approx(both[1])
    assert (TASK.file.sampling_time, TASK.file.steps) == (0.1, 1000)
    assert TASK.actions.high == pytest.approx((1, math.pi / 2))
    assert TASK.actions.low == pytest.approx((-1, -math.pi / 2))
    assert TASK.file.initial.low[:3] == pytest.approx([0.5, 0.5, -math.pi / 2])
    assert TASK.file.initial.high[:3] == pytest.approx([2.5, 2.5, math.pi / 2])


def test_dynamics_by_hand() -> None:
    """Without noise: dt v = .05 along the heading, 3-4-5; dt omega = .1. The count goes on, the seed stays."""
    quiet = NoisyUnicycle(0.1, noise=0.0)
    after = quiet.step(np.array([[1.0, 2.0, math.atan2(4, 3), 0.3, 7.0]]), np.array([[0.5, 1.0]]))
    assert after == pytest.approx(np.array([[1.03, 2.04, math.atan2(4, 3) + 0.1, 0.3, 8.0]]))


def noise(rows: int = 60, steps: int = 400) -> Array:
    """The disturbances w of many episodes at rest with heading 0, from what moves: (rows, steps, 3)."""
    seeds = np.random.default_rng(0).random(rows)
    states = [TASK.system.initial_states(np.column_stack([np.ones((rows, 2)), np.zeros(rows), seeds]))]
    for _ in range(steps):
        states.append(TASK.system.step(states[-1], np.zeros((rows, 2))))
    moved: Array = np.diff(np.stack(states, axis=1)[..., :3], axis=1) / 0.1
    return moved


def test_the_noise_is_normal_with_deviation_one_tenth_and_independent_over_time() -> None:
    w = noise()
    for column in w.reshape(-1, 3).T:
        assert stats.kstest(column / 0.1, "norm").pvalue > 1e-3
    assert w.mean() == pytest.approx(0, abs=4 * 0.1 / math.sqrt(w.size))
    for i in range(3):
        assert stats.pearsonr(w[:, 1:, i].ravel(), w[:, :-1, i].ravel()).pvalue > 1e-3  # over time
        assert stats.pearsonr(w[1:, :, i].ravel(), w[:-1, :, i].ravel()).pvalue > 1e-3  # between episodes
        assert stats.pearsonr(w[..., i].ravel(), w[..., i - 1].ravel()).pvalue > 1e-3  # between axes
    resting = np.cumsum(w[..., :2], axis=1) * 0.1
    assert resting[:, -1].std() == pytest.approx(0.1 * 0.1 * math.sqrt(400), rel=0.2)  # a random walk


def test_no_policy_sees_seed_or_count() -> None:
    states = np.random.default_rng(1).uniform(0, 4, (6, 5))
    others = states.copy()
    others[:, 3:] = [0.9, 77.0]
    steps = np.arange(6)
    assert np.array_equal(TASK.system.features(states, steps), TASK.system.features(others, steps))
    assert np.array_equal(TASK.system.scaled_state(states), TASK.system.scaled_state(others))
    action = TASK.system.controller(states, steps)
    assert action is not None
    assert np.array_equal(action, TASK.system.controller(others, steps))
    assert not np.array_equal(TASK.system.step(states, action)[:, :3], TASK.system.step(others, action)[:, :3])


def test_all_starts_of_the_referee_have_noise_of_their_own() -> None:
    seeds = all_starts(TASK)[:, 3]
    assert len(set(seeds)) == len(seeds) == 128


def test_features_by_hand() -> None:
    """From (1, 2) with heading 0, B is 3 m ahead; A is (3, 2) off, to the left."""
    (features,) = TASK.system.features(np.array([[1.0, 2.0, 0.0, 0.5, 0.0]]), np.zeros(1, dtype=np.int64))
    assert features[:4] == pytest.approx([-0.6, -0.2, 1, 0])
    far, near = math.hypot(3, 2), math.tanh(2 * math.hypot(3, 2))
    assert features[4:8] == pytest.approx([far / 5, near, 3 / far * near, 2 / far * near])
    assert features[8:] == pytest.approx([0.6, math.tanh(6), math.tanh(6), 0])


def test_planners_would_know_the_noise_and_refuse_the_task() -> None:
    """Its state, with which they plan, has five columns."""
    method = build_method(TASK, "flag")
    states = all_starts(TASK)
    model = Model(TASK.system, method, TASK.formula, TASK.actions, TASK.file.steps, TASK.file.hold, (), (), states)
    with pytest.raises(Unsuitable, match="a state of 5 dimensions; a grid has at most 4"):
        axes_of(model, {}, 1.0)
