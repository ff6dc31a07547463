"""The rules of a task: its system under random actions and under its controller, its formula, its recipes."""

from __future__ import annotations

import numpy as np

from stlbench import stl
from stlbench.contract import Array
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.rollout import controller
from stlbench.task import Task, load_task, starts
from stlbench.testing.rules import Rules

__all__ = ["check_task"]


def check_task(name: str, rules: Rules | None = None) -> None:
    """Check a task: its system under random actions and under its controller, its formula, its recipes.

    The rules: `initial_states`, `step`, `signals`, `features`, `scaled_state` and `controller` give finite values of
    the contract's shapes, are pure and leave their arguments alone, and a batch is its rows one by one; the initial
    states lie in the signals' ranges, and features and scaled states of what is in there within [-5, 5]; the nested
    form has the formula's robustness, and the rewarded one is satisfied when the formula is; the controller, where
    there is one, satisfies the formula from some of the report's starts; recipes are for agents that are installed,
    and fit them.

    Args:
        name: of an installed task, or the path of a folder.
        rules: takes those that are kept, for a caller that lists them.

    Raises:
        AssertionError: the rule that is broken.
        UsageError: no such task, a task file with errors, or recipes that their agents do not understand, all of them.
    """
    task, rules = load_task(name), rules or Rules()
    _check_recipes(task)
    rules.keep(True, "each recipe fits its agent", None)
    _check_forms(task, _random_traces(task, rules), rules)
    _check_controller(task, rules)


def _check_recipes(task: Task) -> None:
    problems = list[str]()
    for agent, recipe in task.file.agents.items():
        try:
            plugins.check("agents", Choice(agent), recipe)
        except UsageError as error:
            problems.append(f"agents.{agent}: {str(error).removeprefix(f'{agent}: ')}")
    if problems:
        raise UsageError("\n".join([f"task {task.name}: recipes have errors:", *(f"  {line}" for line in problems)]))


def _random_traces(task: Task, rules: Rules) -> Array:
    """Traces (N, T + 1, k) under random actions, along which the system's functions are checked."""
    generator, system, file, k = np.random.default_rng(0), task.system, task.file, len(task.signals)
    low, high = np.array(task.specification.low), np.array(task.specification.high)
    points = np.concatenate([starts.grid(file.initial, 4), starts.sample(file.training_starts, generator, 4)])
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


def _check_forms(task: Task, traces: Array, rules: Rules) -> None:
    """The rewarded and the nested form against the formula."""
    rewarded = stl.satisfied(task.specification.formula, traces, task.signals)
    same = np.array_equal(rewarded, stl.satisfied(task.formula, traces, task.signals))
    rules.keep(same, "the rewarded form is satisfied when the formula is", rewarded)
    robustness = stl.robustness(task.formula, traces, task.signals)
    nested = stl.robustness(task.specification.nested or task.formula, traces, task.signals)
    rules.keep(np.allclose(nested, robustness), "the nested form has the formula's robustness", nested - robustness)


def _check_controller(task: Task, rules: Rules) -> None:
    control, hold = task.system.controller, task.file.hold
    state = task.system.initial_states(starts.grid(task.file.initial, 8))
    if control(state, np.zeros(len(state), dtype=np.int64)) is None:
        return

    def actions(state: Array, t: Array) -> Array:
        action = control(state, t.astype(np.int64))
        rules.keep(action is not None, "a controller always has an action", action)
        return np.asarray(action, dtype=np.float64)

    for t in range(0, task.file.steps, hold * max(1, task.file.steps // hold // 8)):
        rules.function("controller", actions, (state, np.full(len(state), t)), (len(state), len(task.actions.names)))
    traces = controller.record(task, state)
    assert traces is not None
    satisfied = stl.satisfied(task.formula, traces, task.signals)
    robustness = stl.robustness(task.formula, traces, task.signals)
    rules.keep(
        bool(satisfied.any()), "the controller satisfies the formula from some starts", f"robustness {robustness}"
    )
