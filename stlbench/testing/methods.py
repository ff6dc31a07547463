"""The rules of a reward method, on random traces."""

import json
from functools import partial
from typing import get_args

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Intractable, RewardMethod, Specification, Unsuitable
from stlbench.contract.arrays import are_numbers, kind_of
from stlbench.contract.method import Aim
from stlbench.contract.presentation import Described
from stlbench.registry import plugins
from stlbench.registry.breaches import breach
from stlbench.registry.choices import parse_choice
from stlbench.task import load_task
from stlbench.testing.rules import Rules

_ROWS = 6
_SPECIFICATIONS = tuple(
    Specification(stl.parse(formula), ("x", "y"), (-2.0, -2.0), (2.0, 2.0), steps=15, dt=0.1, nested=nested)
    for formula, nested in (
        ("G[0,12] (norm(x, y) <= 1)", stl.parse("G[0,9] G[0,3] (norm(x, y) <= 1)")),
        ("F[2,5] (x >= 1 | y >= 1) & G[8,12] (abs(x) <= 0.5)", None),
    )
)


def check_method(method: type[RewardMethod] | str, task: str | None = None, rules: Rules | None = None) -> None:
    """Check a reward method on random traces from the box of the signals.

    The rules: parameters are keyword-only, with annotations; `initial_memory`, `along` and `inputs` give finite values
    of the contract's shapes, are pure and leave their arguments alone; a batch is its rows one by one, also where rows
    are at different times; inputs are about in [-1, 1], rewards at most about `scale` in size and none below `floor`;
    `describe` gives what JSON can hold; `preference` has places for kinds of formula.

    Args:
        method: a class, made with its default parameters, or the name of an installed method with parameters.
        task: name of an installed task; where left out, two small formulas, of which the method may refuse one.
        rules: takes those that are kept, for a caller that lists them.

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
            _check_episode(made, rules or Rules())
    if len(refusals) == len(specifications):
        raise refusals[0]


def _made(method: type[RewardMethod] | str, specification: Specification) -> RewardMethod:
    if not isinstance(method, str):
        return method(specification)
    made: RewardMethod = plugins.build("methods", parse_choice(method), specification)
    return made


def _check_episode(method: RewardMethod, rules: Rules) -> None:
    rules.keep(*_initialised(method))
    rules.parameters(type(method), 1)  # it is given the specification
    m, steps = method.memory_size, method.specification.steps
    rules.keep(isinstance(m, int) and m >= 0, "memory_size is a whole number, at least 0", m)
    rules.keep(bool(0 < method.scale < np.inf), "scale is positive and finite", method.scale)
    rules.keep(*_described(method))
    rules.places(method.preference, get_args(Aim))
    traces, action = _traces(method.specification), np.zeros((_ROWS, 1))
    first = (traces[:, 0], np.zeros(_ROWS, dtype=np.int64))
    memories, rewards = [rules.function("initial_memory", method.initial_memory, first, (_ROWS, m))], list[Array]()
    for t in range(steps):
        arguments = (traces[:, t], traces[:, t + 1], action, np.full(_ROWS, t), memories[-1])
        paid, memory = method.along(traces[:, [t, t + 1]].swapaxes(0, 1), action, *arguments[3:])
        rules.keep(*_shapes(paid, memory, m))
        rules.keep(are_numbers(paid), "rewards are an array of real numbers", kind_of(paid))
        reward = paid[0]
        if t % max(1, steps // 12) == 0 or t == steps - 1:
            rules.function("along", partial(_one_step, method), arguments, (_ROWS, 1 + m))
            inputs = rules.function("inputs", method.inputs, (memory,), (_ROWS, method.input_size))
            rules.keep(bool(np.all(np.abs(inputs) <= 2)), "inputs are about in [-1, 1]", inputs)
            if method.counterfactuals:
                check_counterfactual(method, rules, traces[:, t], traces[:, t + 1], t, memories[-1])
        if method.can_end:
            check_over(method, rules, memories[-1], reward, memory)
        memories.append(memory)
        rewards.append(reward)
    largest = float(np.abs(rewards).max())
    rules.keep(largest <= 1.5 * method.scale, f"rewards are at most about scale = {method.scale:g} in size", largest)
    least, floor = float(np.min(rewards)), method.floor
    rule = f"{type(method).__name__}: no reward in the box of the signals is below its floor = {floor:g}"
    rules.keep(least >= floor - 1e-9, rule, least)
    row, at = np.arange(_ROWS), np.linspace(0, steps - 1, _ROWS).astype(np.int64)
    mixed, _ = method.along(traces[row, [at, at + 1]], action, at, np.stack(memories)[at, row])
    rules.keep(np.allclose(mixed[0], np.stack(rewards)[at, row]), "rows may be at different times", mixed[0])
    held = np.arange(4)[:, None] + np.minimum(at, steps - 3)
    along, memory = method.along(traces[row, held], action, held[0], np.stack(memories)[held[0], row])
    same = np.allclose(along, np.stack(rewards)[held[:3], row])
    rules.keep(
        same and np.allclose(memory, np.stack(memories)[held[3], row]),
        "along is step after step",
        along,
    )


def _initialised(method: RewardMethod) -> tuple[bool, str, object]:
    problem = breach(method)
    if "super()" in problem:
        return False, "the constructor calls super().__init__(specification)", problem
    return not problem, "attributes are of the declared types, functions take the declared arguments", problem


def _one_step(
    method: RewardMethod, signals: Array, next_signals: Array, action: Array, t: Integers, memory: Array
) -> Array:
    """The reward and the memory of each copy in a row, (N, 1 + m)."""
    samples = np.stack([signals, next_signals])
    rewards, after = method.along(samples, action, t, memory)
    signals[:], next_signals[:] = samples  # shows a change in place
    return np.column_stack([rewards[0], after])


def _shapes(rewards: Array, memory: Array, m: int) -> tuple[bool, str, object]:
    shapes, expected = (np.shape(rewards), np.shape(memory)), ((1, _ROWS), (_ROWS, m))
    rule, got = (f"rewards {each[0]} and memory {each[1]}" for each in (expected, shapes))
    return shapes == expected, f"along gives {rule}, for a step of {_ROWS} copies", got


def _described(method: RewardMethod) -> tuple[bool, str, object]:
    rule = "describe gives what JSON can hold"
    try:
        json.dumps(dict(method.describe()) if isinstance(method, Described) else {})
    except (TypeError, ValueError) as error:
        return False, rule, error
    return True, rule, None


def _traces(specification: Specification) -> Array:
    """(_ROWS, T + 1, k) in the box of the signals: half of the rows jump about, half move slowly."""
    generator, samples = np.random.default_rng(0), specification.steps + 1
    share = generator.random((_ROWS, samples, len(specification.signals)))
    slow = share[: _ROWS // 2]
    slow[:] = np.clip(slow[:, :1] + np.cumsum((slow - 0.5) / np.sqrt(samples), axis=1), 0, 1)
    low, high = np.array(specification.low), np.array(specification.high)
    traces: Array = low + share * (high - low)
    return traces


def check_over(method: RewardMethod, rules: Rules, memory: Array, reward: Array, after: Array) -> None:
    """The rule on one step of N copies: memories (N, m) before and after it, and what it was paid (N,)."""
    over = rules.function("over", method.over, (memory,), (len(memory),))
    rules.keep(over.dtype.kind == "b", "over gives bool", over.dtype)
    rules.keep(not reward[over].any(), "nothing is paid after it is over", reward[over])
    rules.keep(bool(method.over(after)[over].all()), "what is over remains so", "a memory after it that is not")


def check_counterfactual(
    method: RewardMethod, rules: Rules, signals: Array, next_signals: Array, t: int, memory: Array
) -> None:
    """The rule on one step of N copies: samples (N, k) before and after it, the step, and memories (N, m) before it."""
    rows, at = len(memory), np.full(len(memory), t)
    chance = np.random.default_rng(t).random(memory.shape)
    other = rules.function("counterfactual", method.counterfactual, (signals, at, memory, chance), memory.shape)
    inputs = method.inputs(other)
    rules.keep(bool(np.all(np.abs(inputs) <= 2)), "inputs of a counterfactual memory are about in [-1, 1]", inputs)
    reward, after = method.along(np.stack([signals, next_signals]), np.zeros((rows, 1)), at, other)
    finite = bool(np.isfinite(reward).all() and np.isfinite(after).all())
    rules.keep(finite, "a step from a counterfactual memory is finite", reward)
    within = bool(np.all(reward >= method.floor - 1e-9) and np.all(np.abs(reward) <= 1.5 * method.scale))
    rules.keep(within, "a step from a counterfactual memory is paid from its floor to about its scale", reward)
