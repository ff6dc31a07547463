"""The rules of a system: its functions under random actions, and its controller."""

from __future__ import annotations

import numpy as np

from stlbench.contract import Array
from stlbench.task import Task, starts
from stlbench.task.starts import StateStarts
from stlbench.testing.rules import Rules


def random_traces(task: Task, rules: Rules) -> Array:
    """Traces (N, T + 1, k) under random actions, along which the system's functions are checked."""
    generator, system, file, k = np.random.default_rng(0), task.system, task.file, len(task.signals)
    low, high = np.array(task.specification.low), np.array(task.specification.high)
    points = _points(task, generator)
    n, size = len(points), len(system.state)
    state = rules.function("initial_states", system.initial_states, (points,), (n, size))
    trace = [system.signals(state)]
    within = bool(np.all((low <= trace[0]) & (trace[0] <= high)))
    rules.keep(within, "initial states lie in the signals' ranges", trace[0])
    for t in range(file.steps):
        if t % file.hold == 0:
            action = generator.uniform(task.actions.low, task.actions.high, (n, len(task.actions.names)))
        if t % max(1, file.steps // 8) == 0:
            rules.function("step", system.step, (state, action), (n, size))
            rules.function("signals", system.signals, (state,), (n, k))
            rules.function("signals of (1, N, n)", lambda one: system.signals(one[None])[0], (state,), (n, k))
            features = rules.function("features", system.features, (state, np.full(n, t)), (n, None))
            inside = np.all((low <= trace[-1]) & (trace[-1] <= high), axis=1)
            rules.keep(bool(np.all(np.abs(features[inside]) <= 5)), "features are about in [-1, 1]", features)
            scaled = rules.function("scaled_state", system.scaled_state, (state,), (n, None))
            rules.keep(bool(np.all(np.abs(scaled[inside]) <= 5)), "the scaled state is about in [-1, 1]", scaled)
        state = system.step(state, action)
        trace.append(system.signals(state))
    return np.stack(trace, axis=1)


def check_controller(task: Task, rules: Rules) -> None:
    """That it is a function of state and time; for a task that has one."""
    control, hold = task.system.controller, task.file.hold
    assert isinstance(task.starts, StateStarts)
    state = task.system.initial_states(starts.grid(task.starts.initial, 8))
    if control(state, np.zeros(len(state), dtype=np.int64)) is None:
        return

    def actions(state: Array, t: Array) -> Array:
        action = control(state, t.astype(np.int64))
        rules.keep(action is not None, "a controller always has an action", action)
        return np.asarray(action, dtype=np.float64)

    for t in range(0, task.file.steps, hold * max(1, task.file.steps // hold // 8)):
        rules.function("controller", actions, (state, np.full(len(state), t)), (len(state), len(task.actions.names)))


def _points(task: Task, generator: np.random.Generator) -> Array:
    """Points of the regions where episodes begin, in the system's coordinates."""
    assert isinstance(task.starts, StateStarts)
    initial = task.starts.initial
    training = task.file.training.starts or initial
    return np.concatenate([starts.grid(initial, 4), starts.sample(training, generator, 4)])
