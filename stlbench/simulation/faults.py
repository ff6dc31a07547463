"""Calls of plugins: what they return is checked, and one that fails outside of a cell costs its own answer alone.

A message has the name of the plugin, the rule, the step, and the number of copies.
"""

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, NoReturn, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionGrid, Actions, Array, Integers, RewardMethod, Truth
from stlbench.contract.arrays import are_numbers, kind_of
from stlbench.errors import UsageError, cause
from stlbench.records.identity import CellId
from stlbench.registry import plugins
from stlbench.registry.plugins import PluginWarning
from stlbench.task.task import Task

_ROUNDING = 1e-6  # share of an axis' span by which an action may be beyond its ends: that of single precision


class PluginFault(UsageError):
    """A plugin, or an environment, broke its contract: "method hprs: reward is nan at step 17 in 3 of 16 copies"."""


_Numbers = TypeVar("_Numbers", bound=NDArray[Any])


def own(array: _Numbers) -> _Numbers:
    """A copy for a method, in the same layout: what it changes in place is in no trace, which the referee scores."""
    copied: _Numbers = array.copy(order="K")
    return copied


def begin(method: RewardMethod, signals: Array, t: Integers) -> Array:
    """The memory (N, m) at signals (N, k) and steps t (N,). Raises `PluginFault`."""
    return check_memory(method, method.initial_memory(own(signals), own(t)), t)


def pay(method: RewardMethod, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
    """The result of `RewardMethod.along`: rewards (hold, N), and the memory after them. Raises `PluginFault`."""
    paid = method.along(own(samples), own(action), own(t), own(memory))
    if not (isinstance(paid, tuple) and len(paid) == 2):
        _fault(method, f"along gives {_shown(paid)}, the contract says rewards and memory")
    rewards, memory = paid
    check_rewards(method, rewards, len(samples) - 1, t)
    check_memory(method, memory, t + len(samples) - 1)
    return rewards, memory


def check_rewards(method: RewardMethod, rewards: Array, hold: int, t: Integers) -> None:
    """Rewards (hold, N) while an action was held from steps t (N,) on."""
    _numbers(method, "rewards", rewards, (hold, len(t)))
    if not _finite(rewards):
        _tell(method, "reward", rewards.T, t + 1)


def check_memory(method: RewardMethod, memory: Array, t: Integers) -> Array:
    """The same memory (N, m), of copies at steps t (N,)."""
    _numbers(method, "memory", memory, (len(t), method.memory_size))
    if method.memory_size and not _finite(memory):
        _tell(method, "memory", memory[:, None], t)
    return memory


def check_over(method: RewardMethod, over: Truth, count: int) -> None:
    """Whether each of so many copies is over, (N,)."""
    _shaped(method, "over", over, (count,))
    if not (isinstance(over, np.ndarray) and over.dtype.kind == "b"):
        _fault(method, f"over gives {_shown(over)}, the contract says whether: bool")


def check_states(task: Task, states: Array, shape: tuple[int, ...]) -> None:
    """The states (N, n) of a system's `step` or of a start."""
    _numbers(task, "states", states, shape)


def check_signals(task: Task, signals: Array, count: int) -> None:
    """A sample of each copy, (N, k)."""
    _numbers(task, "signals", signals, (count, len(task.signals)))


def check_samples(task: Task, samples: Array, hold: int, t: Integers) -> None:
    """Signals (hold + 1, N, k), of which the first are at steps t (N,)."""
    _numbers(task, "signals", samples, (hold + 1, len(t), len(task.signals)))
    if not _finite(samples):
        _tell(task, "signal", samples.transpose(1, 0, 2), t, task.signals)


def observation(task: Task, method: RewardMethod, parts: list[Array], t: Integers) -> Array:
    """An observation (N, D) of its parts: features (N, d), times, and the inputs (N, i) of a method that has any."""
    if type(parts[0]) is not np.ndarray or parts[0].shape[:-1] != t.shape:
        _numbers(task, "features", parts[0], (len(t), np.size(parts[0]) // len(t)))
    if len(parts) > 2:
        _numbers(method, "inputs", parts[2], (len(t), method.input_size))
    joined: Array = np.concatenate(parts, axis=1)
    if not _finite(joined):
        if not _finite(parts[0]):
            _tell(task, "feature", parts[0][:, None], t, range(parts[0].shape[1]))
        if len(parts) > 2:  # else large features have a sum that overflows, and nothing is wrong
            check_inputs(method, parts[2], t)
    return joined


def check_inputs(method: RewardMethod, inputs: Array, t: Integers) -> None:
    _numbers(method, "inputs", inputs, (len(t), method.input_size))
    if not _finite(inputs):
        _tell(method, "input", inputs[:, None], t)


def check_action(actions: Actions, action: Array | Integers, t: Integers) -> None:
    """Indices (N,) of a grid, or vectors (N, axes), for copies at steps t (N,)."""
    kind = array_of_actions(action).dtype.kind
    if kind == "i" and isinstance(actions, ActionGrid):
        rule: tuple[int, ...] = (len(t),)
        right = action.astype(np.uint64, copy=False) < actions.size  # a negative number is large as an unsigned one
        what = f"none of 0..{actions.size - 1}"
    elif kind == "f":
        rule, right, what = (len(t), len(actions.names)), np.isfinite(action), "no finite number"
    else:
        kinds = "whole numbers or floats" if isinstance(actions, ActionGrid) else "floats, as the task's are continuous"
        raise PluginFault(f"the agent's actions should be {kinds}, they are {action.dtype}")
    if action.shape != rule:
        raise PluginFault(f"the agent's actions have shape {action.shape}, for {len(t)} copies it is {rule}")
    if not np.logical_and.reduce(right, None):
        place = tuple(np.argwhere(~right)[0].tolist())
        raise PluginFault(f"the agent's action {action[place]} is {what}, at step {t[place[0]]} of copy {place[0]}")


def array_of_actions(action: Any) -> Array | Integers:
    """The same actions. Raises `PluginFault` where they are no array."""
    if not isinstance(action, np.ndarray):
        raise PluginFault(f"the agent's actions are {_shown(action)}, the contract says an array")
    return action


def out_of_range(actions: Actions, vectors: Array) -> str | None:
    """The first vector (N, axes) beyond an axis' ends, by more than rounding: "an action has v 2; v is in [-1, 1]"."""
    low, high = np.array(actions.low), np.array(actions.high)
    beyond = _ROUNDING * (high - low)
    wrong = ~((vectors >= low - beyond) & (vectors <= high + beyond))
    if not wrong.any():
        return None
    axis = int(np.flatnonzero(wrong.any(axis=0))[0])
    name, value = actions.names[axis], vectors[wrong[:, axis], axis][0]
    return f"an action has {name} {value:g}; {name} is in [{low[axis]:g}, {high[axis]:g}]"


def _numbers(owner: RewardMethod | Task, what: str, values: Any, shape: tuple[int, ...]) -> None:
    if type(values) is np.ndarray and values.shape == shape and values.dtype.kind in "fbiu":
        return  # at once, as this is asked at every step
    if not (hasattr(values, "dtype") and are_numbers(values)):
        _fault(owner, f"its {what} are {_shown(values)}, the contract says an array of real numbers, float64")
    _shaped(owner, what, values, shape)


def _shown(values: Any) -> str:
    """The type of values: "complex128", "a masked array", "list"."""
    return kind_of(values) if hasattr(values, "dtype") else type(values).__name__


def _shaped(owner: RewardMethod | Task, what: str, value: Any, shape: tuple[int, ...]) -> None:
    if np.shape(value) != shape:
        _fault(owner, f"the shape of its {what} is {np.shape(value)}, the contract says {shape}")


def _finite(values: Array) -> bool:
    """Whether all are finite, by their sum, in half the time. A sum of finite numbers may overflow too."""
    return math.isfinite(np.add.reduce(values, None))


def _tell(owner: RewardMethod | Task, what: str, values: Array, t: Integers, names: Sequence[object] = ()) -> None:
    """Tell the first of (N, steps, ...) that is not finite, from step t on; none if only the sum is infinite."""
    wrong = ~np.isfinite(values)
    if wrong.any():
        row, later, *_ = place = tuple(np.argwhere(wrong)[0].tolist())
        copies = int(wrong.reshape(len(values), -1).any(axis=1).sum())
        which = f"{what} {names[place[-1]]}" if names else what
        _fault(owner, f"{which} is {values[place]} at step {t[row] + later} in {copies} of {len(values)} copies")


def _fault(owner: RewardMethod | Task, what: str) -> NoReturn:
    if isinstance(owner, RewardMethod):
        name = plugins.name_of("methods", type(owner)) or type(owner).__name__
        raise PluginFault(f"method {name}: {what}")
    raise PluginFault(f"task {owner.name}: {what}")


_T = TypeVar("_T")
_Answer = TypeVar("_Answer", covariant=True)


@dataclass(frozen=True)
class Question(Generic[_Answer]):
    """A call that runs code of plugins. Another process can make it, as its parts can be pickled."""

    function: Callable[..., _Answer]  # importable by its name. It may raise whatever the plugins raise
    arguments: tuple[Any, ...]
    plugins: tuple[tuple[str, str], ...]
    """Kind and name of each plugin whose code runs, as in ("tasks", "hold-disc"); other code is
    ("functions", "module:function")."""
    failed: str  # the text before the reason, if there is no answer: "task x: its controller cannot be scored"

    def answer(self) -> _Answer:
        return self.function(*self.arguments)


def plugins_of(cell: CellId) -> tuple[tuple[str, str], ...]:
    """The plugins of a question about the policy of a cell, for `Question.plugins`."""
    return ("tasks", cell.task.name), ("methods", cell.method.name), ("agents", cell.agent.name)


@dataclass(frozen=True)
class Unanswered:
    """In the place of an answer."""

    reason: str  # in one line: "no result after 120 s", "ValueError: no such luck"
    is_refusal: bool = False
    """The reason is a whole message of stlbench's own (`UsageError`), as where a plugin is not installed."""


class Ask(Protocol):
    """Answers questions, in their order."""

    def __call__(self, questions: Sequence[Question[_T]]) -> Sequence[_T | Unanswered]:
        """The answers."""


def ask_here(questions: Sequence[Question[_T]]) -> list[_T | Unanswered]:
    """All answers, in this process: one that hangs is waited for, and one that ends the process ends it."""
    return [answered_here(question) for question in questions]


def answered_here(question: Question[_T]) -> _T | Unanswered:
    try:
        return question.answer()
    except PluginFault as error:
        return Unanswered(str(error))
    except (UsageError, ImportError) as error:
        return Unanswered(str(error) or cause(error), is_refusal=True)
    except Exception as error:
        return Unanswered(cause(error))


def answers(questions: Sequence[Question[_T]], ask: Ask) -> dict[Question[_T], _T]:
    """The answers that there are. A `PluginWarning` tells each failure that is no refusal."""
    answered = dict[Question[_T], _T]()
    for question, answer in zip(questions, ask(questions), strict=True):
        if not isinstance(answer, Unanswered):
            answered[question] = answer
        elif not answer.is_refusal:
            warnings.warn(f"{question.failed}: {answer.reason}", PluginWarning, stacklevel=3)
    return answered
