"""Conformance checks: what the contract asks of a method and of a task, for a plugin author's own tests.

    from stlbench.testing import check_method

    def test_it_keeps_the_contract() -> None:
        check_method(MyMethod)  # or by name, with parameters: check_method("my-method[beta=2]")

A check runs the plugin and returns nothing. The first rule that is broken is an `AssertionError` that names the rule
and what there was instead. That a reward is the right one is not checked: compute some by hand.
"""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Intractable, RewardMethod, Specification, Unsuitable
from stlbench.errors import UsageError
from stlbench.presentation import Described
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, parse_choice
from stlbench.rollout import controller
from stlbench.task import Task, load_task, starts

__all__ = ["check_method", "check_task"]

_ROWS = 6
_SPECIFICATIONS = tuple(
    Specification(stl.parse(formula), ("x", "y"), (-2.0, -2.0), (2.0, 2.0), steps=15, dt=0.1, nested=nested)
    for formula, nested in (
        ("G[0,12] (norm(x, y) <= 1)", stl.parse("G[0,9] G[0,3] (norm(x, y) <= 1)")),
        ("F[2,5] (x >= 1 | y >= 1) & G[8,12] (abs(x) <= 0.5)", None),
    )
)


def check_method(method: type[RewardMethod] | str, task: str | None = None) -> None:
    """Check a reward method on random traces from the box of the signals.

    The rules: `initial_memory`, `step` and `inputs` give finite values of the contract's shapes, are pure and leave
    their arguments alone; a batch is its rows one by one, also where rows are at different times; inputs are about in
    [-1, 1], rewards at most about `scale` in size and none below `floor`; `describe` gives what JSON can hold.

    Args:
        method: a class, made with its default parameters, or the name of an installed method with parameters.
        task: name of an installed task; where left out, two small formulas, of which the method may refuse one.

    Raises:
        AssertionError: the rule that is broken.
        Unsuitable, Intractable: the method refuses the task; no rule is broken.
        UsageError: no such method or task, or a wrong parameter; the message says what there is.
    """
    specifications = _SPECIFICATIONS if task is None else (load_task(task).specification,)
    refusals = list[Exception]()
    for specification in specifications:
        try:
            made = _made(method, specification)
        except (Unsuitable, Intractable) as refusal:
            refusals.append(refusal)
        else:
            _check_episode(made)
    if len(refusals) == len(specifications):
        raise refusals[0]


def check_task(name: str) -> None:
    """Check an installed task: its system under random actions and under its controller, its formula, its recipes.

    The rules: `initial_states`, `step`, `signals`, `features`, `scaled_state` and `controller` give finite values of
    the contract's shapes, are pure and leave their arguments alone, and a batch is its rows one by one; the initial
    states lie in the signals' ranges, and features and scaled states of what is in there within [-5, 5]; the nested
    form has the formula's robustness, and the rewarded one is satisfied when the formula is; the controller, where
    there is one, satisfies the formula from some of the report's starts; recipes are for agents that are installed,
    and fit them.

    Raises:
        AssertionError: the rule that is broken.
        UsageError: no such task, a task file with errors, or recipes that their agents do not understand, all of them.
    """
    task = load_task(name)
    _check_recipes(task)
    _check_forms(task, _random_traces(task))
    _check_controller(task)


def _check_recipes(task: Task) -> None:
    problems = list[str]()
    for agent, recipe in task.file.agents.items():
        try:
            plugins.check("agents", Choice(agent), recipe)
        except UsageError as error:
            problems.append(f"agents.{agent}: {str(error).removeprefix(f'{agent}: ')}")
    if problems:
        raise UsageError("\n".join([f"task {task.name}: recipes have errors:", *(f"  {line}" for line in problems)]))


def _random_traces(task: Task) -> Array:
    """Traces (N, T + 1, k) under random actions, along which the system's functions are checked."""
    generator, system, file, k = np.random.default_rng(0), task.system, task.file, len(task.signals)
    low, high = np.array(task.specification.low), np.array(task.specification.high)
    points = np.concatenate([starts.grid(file.initial, 4), starts.sample(file.training_starts, generator, 4)])
    n, size = len(points), len(system.state)
    state = _check_function("initial_states", system.initial_states, (points,), (n, size))
    trace = [system.signals(state)]
    _rule(bool(np.all((low <= trace[0]) & (trace[0] <= high))), "initial states lie in the signals' ranges", trace[0])
    for t in range(file.steps):
        if t % file.hold == 0:
            action = generator.uniform(task.actions.low, task.actions.high, (n, len(task.actions.names)))
        if t % max(1, file.steps // 8) == 0:
            _check_function("step", system.step, (state, action), (n, size))
            _check_function("signals", system.signals, (state,), (n, k))
            _check_function("signals of (1, N, n)", lambda one: system.signals(one[None])[0], (state,), (n, k))
            features = _check_function("features", system.features, (state, np.full(n, t)), (n, None))
            inside = np.all((low <= trace[-1]) & (trace[-1] <= high), axis=1)
            _rule(bool(np.all(np.abs(features[inside]) <= 5)), "features are about in [-1, 1]", features)
            scaled = _check_function("scaled_state", system.scaled_state, (state,), (n, None))
            _rule(bool(np.all(np.abs(scaled[inside]) <= 5)), "the scaled state is about in [-1, 1]", scaled)
        state = system.step(state, action)
        trace.append(system.signals(state))
    return np.stack(trace, axis=1)


def _check_forms(task: Task, traces: Array) -> None:
    """The rewarded and the nested form against the formula."""
    rewarded = stl.satisfied(task.specification.formula, traces, task.signals)
    same = np.array_equal(rewarded, stl.satisfied(task.formula, traces, task.signals))
    _rule(same, "the rewarded form is satisfied when the formula is", rewarded)
    robustness = stl.robustness(task.formula, traces, task.signals)
    nested = stl.robustness(task.specification.nested or task.formula, traces, task.signals)
    _rule(np.allclose(nested, robustness), "the nested form has the formula's robustness", nested - robustness)


def _check_controller(task: Task) -> None:
    control, hold = task.system.controller, task.file.hold
    state = task.system.initial_states(starts.grid(task.file.initial, 8))
    if control(state, np.zeros(len(state), dtype=np.int64)) is None:
        return

    def actions(state: Array, t: Array) -> Array:
        action = control(state, t.astype(np.int64))
        _rule(action is not None, "a controller always has an action", action)
        return np.asarray(action, dtype=np.float64)

    for t in range(0, task.file.steps, hold * max(1, task.file.steps // hold // 8)):
        _check_function("controller", actions, (state, np.full(len(state), t)), (len(state), len(task.actions.names)))
    traces = controller.record(task, state)
    assert traces is not None
    satisfied = stl.satisfied(task.formula, traces, task.signals)
    robustness = stl.robustness(task.formula, traces, task.signals)
    _rule(bool(satisfied.any()), "the controller satisfies the formula from some starts", f"robustness {robustness}")


def _made(method: type[RewardMethod] | str, specification: Specification) -> RewardMethod:
    if not isinstance(method, str):
        return method(specification)
    made: RewardMethod = plugins.build("methods", parse_choice(method), specification)
    return made


def _check_episode(method: RewardMethod) -> None:
    m, steps = method.memory_size, method.specification.steps
    _rule(isinstance(m, int) and m >= 0, "memory_size is a whole number, at least 0", m)
    _rule(bool(0 < method.scale < np.inf), "scale is positive and finite", method.scale)
    try:
        json.dumps(dict(method.describe()) if isinstance(method, Described) else {})
    except (TypeError, ValueError) as error:
        raise AssertionError(f"rule broken: describe gives what JSON can hold; got {error}") from error
    traces, action = _traces(method.specification), np.zeros((_ROWS, 1))
    memories, rewards = (
        [
            _check_function(
                "initial_memory", method.initial_memory, (traces[:, 0], np.zeros(_ROWS, dtype=np.int64)), (_ROWS, m)
            )
        ],
        list[Array](),
    )
    for t in range(steps):
        arguments = (traces[:, t], action, traces[:, t + 1], np.full(_ROWS, t), memories[-1])
        reward, memory = method.step(*arguments)
        _rule(np.shape(reward) == (_ROWS,), "the reward has shape (N,)", np.shape(reward))
        if t % max(1, steps // 12) == 0 or t == steps - 1:
            _check_function("step", lambda *values: np.column_stack(method.step(*values)), arguments, (_ROWS, 1 + m))
            inputs = _check_function("inputs", method.inputs, (memory,), (_ROWS, method.input_size))
            _rule(bool(np.all(np.abs(inputs) <= 2)), "inputs are about in [-1, 1]", inputs)
        memories.append(memory)
        rewards.append(reward)
    largest = float(np.abs(rewards).max())
    _rule(largest <= 1.5 * method.scale, f"rewards are at most about scale = {method.scale:g} in size", largest)
    least, floor = float(np.min(rewards)), method.floor
    name = type(method).__name__
    _rule(least >= floor - 1e-9, f"{name}: no reward in the box of the signals is below its floor = {floor:g}", least)
    row, at = np.arange(_ROWS), np.linspace(0, steps - 1, _ROWS).astype(np.int64)
    mixed, _ = method.step(traces[row, at], action, traces[row, at + 1], at, np.stack(memories)[at, row])
    _rule(np.allclose(mixed, np.stack(rewards)[at, row]), "rows may be at different times", mixed)
    held = np.arange(4)[:, None] + np.minimum(at, steps - 3)
    along, memory = method.along(traces[row, held], action, held[0], np.stack(memories)[held[0], row])
    same = np.allclose(along, np.stack(rewards)[held[:3], row])
    _rule(same and np.allclose(memory, np.stack(memories)[held[3], row]), "along is step after step", along)


def _check_function(
    name: str, function: Callable[..., Array], arguments: tuple[Array, ...], shape: tuple[int | None, ...]
) -> Array:
    """Shape (None: any), finite values, purity, and that a batch is its rows one by one."""
    copies = tuple(argument.copy() for argument in arguments)
    value = np.array(function(*copies))
    fits = value.ndim == len(shape) and all(size in (None, n) for size, n in zip(shape, value.shape, strict=True))
    _rule(fits, f"{name} has shape {shape}", value.shape)
    _rule(bool(np.isfinite(value).all()), f"{name} is finite", value)
    _rule(all(map(np.array_equal, copies, arguments)), f"{name} leaves its arguments alone", "one that it changed")
    _rule(np.array_equal(function(*copies), value), f"{name} is pure", "another value for the same arguments")
    for i in range(len(value)):
        row = function(*(argument[i : i + 1] for argument in copies))
        _rule(np.allclose(row, value[i : i + 1]), f"{name} of a batch is that of its rows", f"a difference in row {i}")
    return value


def _traces(specification: Specification) -> Array:
    """(_ROWS, T + 1, k) in the box of the signals: half of the rows jump about, half move slowly."""
    generator, samples = np.random.default_rng(0), specification.steps + 1
    share = generator.random((_ROWS, samples, len(specification.signals)))
    slow = share[: _ROWS // 2]
    slow[:] = np.clip(slow[:, :1] + np.cumsum((slow - 0.5) / np.sqrt(samples), axis=1), 0, 1)
    low, high = np.array(specification.low), np.array(specification.high)
    traces: Array = low + share * (high - low)
    return traces


def _rule(kept: bool, rule: str, got: object) -> None:
    if not kept:
        raise AssertionError(f"rule broken: {rule}; got {got}")
