"""A task as pure functions of JAX arrays pays what the ordinary environment pays.

Skipped where JAX is missing: it comes with the extra `bench`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from helpers.studies import load

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification
from stlbench.simulation.environment import Simulator
from stlbench.task import Task, build_method, load_task

jax = pytest.importorskip("jax")
jnp = jax.numpy
DEVICE = load("device_world")
COPIES, EPISODES = 3, 2


class LeastSoFar(RewardMethod):
    """The least margin of the first term since the episode began, which its memory has."""

    memory_size = 1

    def __init__(self, specification: Specification) -> None:
        super().__init__(specification)
        self._margin = specification.margin(specification.terms[0].psi)

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        return self._margin(signals)[:, None]

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        paid = []
        for sample in samples[1:]:
            memory = np.minimum(memory, self._margin(sample)[:, None])
            paid.append(memory[:, 0])
        return np.stack(paid), memory


def built(choice: str) -> Callable[[Specification], RewardMethod]:
    return LeastSoFar if choice == "least" else lambda given: build_method(given, choice)


def given(task: Task) -> tuple[Array, Array]:
    """Starts (copies, episodes, n), and random actions (copies, decisions, axes), some beyond their range."""
    low, high = np.array(task.actions.low), np.array(task.actions.high)
    starts = task.starts.report_and_selection()[0][: COPIES * EPISODES].reshape(COPIES, EPISODES, -1)
    decisions = EPISODES * task.file.steps // task.file.hold
    return starts, np.random.default_rng(0).uniform(1.1 * low, 1.1 * high, (COPIES, decisions, len(low)))


def ordinary(task: Task, method: RewardMethod) -> tuple[Array, Array]:
    """Rewards (copies, decisions) and samples (copies, decisions, hold, k) of the simulator that trainings use."""
    starts, actions = given(task)
    simulator, steps = Simulator(task, method), []
    for decision in range(actions.shape[1]):
        if decision * task.file.hold % task.file.steps == 0:
            simulator.reset(starts[:, decision * task.file.hold // task.file.steps])
        steps.append(simulator.advance(actions[:, decision]))
    return np.stack([step.reward for step in steps], axis=1), np.stack([step.samples for step in steps], axis=1)


def on_device(task: Task, choice: str) -> Any:
    world = DEVICE.device_world(task, built(choice))
    starts, actions = map(jnp.asarray, given(task))
    return jax.jit(jax.vmap(lambda begun, taken: DEVICE.run(world, begun, taken)))(starts, actions)


@pytest.mark.parametrize("choice", ["raw", "funnel", "funnel[variant=code,shape=normalised]", "least"])
@pytest.mark.parametrize("name", DEVICE.TASKS)
def test_rewards_and_samples_are_those_of_the_environment(name: str, choice: str) -> None:
    """In two episodes, the second of which begins inside the scan."""
    task = load_task(name)
    with jax.enable_x64(True):
        found = on_device(task, choice)
    rewards, samples = ordinary(task, built(choice)(task.specification))
    assert found.rewards.dtype == np.float64
    assert np.ptp(rewards) > 0.1
    np.testing.assert_allclose(found.rewards, rewards, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.samples, samples, rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", DEVICE.TASKS)
def test_the_usual_32_bits_are_off_by_their_rounding(name: str) -> None:
    task = load_task(name)
    found = on_device(task, "funnel")
    rewards, _ = ordinary(task, build_method(task, "funnel"))
    assert found.rewards.dtype == np.float32
    np.testing.assert_allclose(found.rewards, rewards, rtol=1e-4, atol=1e-3)


def test_a_trace_that_comes_back_is_scored_as_any_other() -> None:
    task = load_task("overlap")
    with jax.enable_x64(True):
        found = on_device(task, "raw")
    _, samples = ordinary(task, build_method(task, "raw"))
    first = task.system.signals(given(task)[0][:, :1])
    robustness = []
    for course in (np.asarray(found.samples), samples):
        trace = np.concatenate([first, course.reshape(COPIES, EPISODES, task.file.steps, -1)[:, 0]], axis=1)
        robustness.append(stl.robustness(task.formula, trace, task.signals))
    np.testing.assert_allclose(*robustness, atol=1e-9)


def test_the_sum_of_rewards_has_a_gradient() -> None:
    """By the actions; the simulator's, by differences, is the same."""
    task = load_task("pendulum")
    start, size, when = given(task)[0][:1, 0], 1e-4, 395
    actions = np.full((420, 1), 0.1)

    def total(taken: Array) -> float:
        simulator = Simulator(task, build_method(task, "raw"))
        simulator.reset(start)
        return float(sum(simulator.advance(row[None]).reward[0] for row in taken))

    with jax.enable_x64(True):
        world = DEVICE.device_world(task, built("raw"))
        slope = jax.jit(jax.grad(lambda taken: DEVICE.run(world, jnp.asarray(start), taken).rewards.sum()))(actions)
        found = float(slope[when, 0])
    changed = size * (np.arange(len(actions)) == when)[:, None]
    assert found != 0
    assert found == pytest.approx((total(actions + changed) - total(actions - changed)) / (2 * size), rel=1e-4)


def filled(state: Any) -> Any:
    """Writes into a part of a part, and reads what was written through another one."""
    change = np.empty_like(state)
    half = change[:, :2]
    np.multiply(state[:, 0], 2.0, out=half[:, 1])
    half[:, 0] = np.sin(state[:, 1])
    change[:, 2] = half.sum(axis=1)
    change *= state
    return change


def picked(state: Any) -> Any:
    """A part by a list is a copy: writing to it leaves the whole as it is."""
    other = state[:, [0, 2]]
    other[:, 0] = 7.0
    x, y, z = state.T
    return np.stack([np.where(x > 0, y, z), other[:, 0] + x, -(abs(z) ** 2)], axis=1)


@pytest.mark.parametrize("function", [filled, picked])
def test_a_traced_array_is_as_one_of_numpy(function: Callable[[Any], Any]) -> None:
    state = np.random.default_rng(0).normal(size=(4, 3))
    with jax.enable_x64(True):
        found = jax.jit(lambda value: function(DEVICE.Traced(value)).value)(state)
    np.testing.assert_allclose(found, function(state), rtol=1e-12)


@pytest.mark.parametrize(
    "function",
    [
        np.asarray,
        np.add.reduce,
        np.trim_zeros,
        bool,
        float,
        lambda x: np.arange(3)[x],
        lambda x: np.zeros(3).__setitem__(0, x),
    ],
)
def test_what_asks_for_numbers_is_refused(function: Callable[[Any], Any]) -> None:
    """A function that would leave JAX fails, and does not give a wrong number."""
    with pytest.raises((TypeError, IndexError, ValueError)):
        jax.jit(lambda value: function(DEVICE.Traced(value)))(jnp.array(1))
