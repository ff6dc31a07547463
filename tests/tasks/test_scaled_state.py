"""What policies see of a task: what features have beyond the state is declared, and the state alone is all of it."""

from __future__ import annotations

from functools import cache
from inspect import signature
from itertools import combinations

import numpy as np
import pytest
from helpers.task_lists import SYSTEMS, WITHOUT_RECIPES

from stlbench.contract import Array
from stlbench.task import Task
from stlbench.task import load_task as load_anew

ROBOTS = ("hold-disc", "hold-disc-coarse", "robot-nav", "annulus", "reach-stay", "overlap")

SHOWN = {
    "cartpole": ("x", "theta", "d_x", "d_theta"),
    "ball-in-cup": tuple(f"{d}{part}" for d in ("", "d_") for part in ("cup_x", "cup_z", "ball_x", "ball_z")),
    **dict.fromkeys(("fetch-avoid", "fetch-reach"), ("x", "y", "z", "v_x", "v_y", "v_z")),
    "patrol": ("x", "y", "heading"),
    "dwell": ("x", "y", "heading"),
}
"""The columns that the scaled state shows; all of the other tasks'."""
WRAPPED = dict.fromkeys((*ROBOTS, "patrol", "dwell", "unicycle-choice"), "heading") | {
    "cartpole": "theta",
    "zones": "phase",
}
WRAPPED |= dict.fromkeys(("quadrotor-gates", "quadrotor-patrol"), "yaw")
"""The angle that is shown as its cosine and sine."""


@cache
def load_task(name: str) -> Task:
    return load_anew(name)


@cache
def states(name: str) -> Array:
    """The states (M, n) at the decisions of two episodes under the controller."""
    task = load_task(name)
    found = [task.starts.report_and_selection()[0][:32:16]]
    for t in range(task.file.steps):
        if t % task.file.hold == 0:
            action = task.system.controller(found[-1], np.full(len(found[-1]), t))
        assert action is not None
        found.append(task.system.step(found[-1], action))
    return np.concatenate(found[:: task.file.hold])


def columns(name: str) -> list[int]:
    """Where the shown columns are in the state."""
    system = load_task(name).system
    return [system.state.index(column) for column in SHOWN.get(name, system.state)]


@pytest.mark.parametrize("name", SYSTEMS)
def test_what_features_have_beyond_the_state_is_declared(name: str) -> None:
    beyond = load_task(name).system.beyond_state
    assert bool(beyond) == (name not in WITHOUT_RECIPES)  # else policies see the scaled state and the formula's view
    assert all(words == words.strip() and 0 < len(words) < 80 for words in beyond)


@pytest.mark.parametrize("name", SYSTEMS)
def test_it_is_finite_and_about_in_its_range_under_the_controller(name: str) -> None:
    scaled = load_task(name).system.scaled_state(states(name))
    assert np.isfinite(scaled).all()
    assert (np.abs(scaled) <= 1.5).mean(axis=0).min() > 0.98
    assert np.abs(scaled).max(axis=0).min() > 0.1  # no column is so small that it says nothing


@pytest.mark.parametrize("name", SYSTEMS)
def test_it_is_a_function_of_what_it_shows_alone(name: str) -> None:
    """The time is no argument; the columns that are not shown change nothing."""
    system, some = load_task(name).system, states(name)[::7]
    other = some + 1.0
    other[:, columns(name)] = some[:, columns(name)]
    assert list(signature(system.scaled_state).parameters) == ["state"]
    assert np.array_equal(system.scaled_state(other), system.scaled_state(some))


@pytest.mark.parametrize("name", SYSTEMS)
def test_different_states_are_seen_as_different(name: str) -> None:
    """Of any two states, what is shown differs about as much as the states do, angles up to whole turns."""
    system, generator = load_task(name).system, np.random.default_rng(0)
    some = generator.permutation(states(name))[:100]
    half = len(some) // 2
    some[:half, columns(name)] += generator.normal(scale=0.1, size=(half, len(columns(name))))
    scaled = system.scaled_state(some)
    one, other = map(list, zip(*combinations(range(len(some)), 2), strict=True))
    apart = some[one] - some[other]
    if name in WRAPPED:
        angle = system.state.index(WRAPPED[name])
        apart[:, angle] = (apart[:, angle] + np.pi) % (2 * np.pi) - np.pi
    difference = np.abs(apart[:, columns(name)]).max(axis=1)
    seen = np.abs(scaled[one] - scaled[other]).max(axis=1)
    assert (seen >= 0.03 * difference).all()


@pytest.mark.parametrize("name", WRAPPED)
def test_a_whole_turn_is_not_seen(name: str) -> None:
    system, some = load_task(name).system, states(name)[:5]
    turned = some.copy()
    turned[:, system.state.index(WRAPPED[name])] += 2 * np.pi
    assert system.scaled_state(turned) == pytest.approx(system.scaled_state(some), abs=1e-12)


def test_the_pendulum_sees_a_whole_turn_up_to_9_rad() -> None:
    scaled = load_task("pendulum").system.scaled_state(np.array([[0.0, 3], [2 * np.pi, -6], [9.5, 0], [-20, 12]]))
    assert scaled == pytest.approx(np.array([[0, 0.5], [2, -1], [9 / np.pi, 0], [-9 / np.pi, 2]]))


@pytest.mark.parametrize("name", ["integrator-or", "formation", "fetch-reach", "patrol", "dwell", "either-or"])
def test_places_are_scaled_by_the_range_of_their_signals(name: str) -> None:
    task = load_task(name)
    k, shown = len(task.signals), columns(name)
    ends = np.zeros((2, len(task.system.state)))
    ends[:, shown[:k]] = task.specification.low, task.specification.high
    assert task.system.scaled_state(ends)[:, :k] == pytest.approx(np.repeat([[-1.0], [1.0]], k, axis=1))


def test_models_by_hand() -> None:
    """A cart at .9 m with a leaning pole; a cup .1 m aside and a ball .2 m aside, both .05 m up."""
    cart = load_task("cartpole").system.scaled_state(np.array([[0.9, np.pi / 6, 1.0, -2.0, 7.0, 7.0]]))
    assert cart == pytest.approx(np.array([[0.5, np.sqrt(0.75), 0.5, 0.5, -0.5]]))
    state = np.array([[0.1, 0.05, 0.2, 0.05, 1, 2, -1, 0, 7, 7, 7, 7, 0.1, 0]])
    ball = load_task("ball-in-cup").system.scaled_state(state)
    assert ball == pytest.approx(np.array([[0.3, 0.15, 0.6, 0.15, 0.5, 1, -0.5, 0]]))
