"""The environment of a task: made, checked against the task file, and read; where its copies come from."""

import atexit
import math
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property, lru_cache, partial
from typing import Any, Literal, TypeAlias

import gymnasium
import numpy as np
from gymnasium.spaces import Box

from stlbench.contract import Array, GymTask, cause
from stlbench.errors import UsageError
from stlbench.task.file import Axis, Environment, TaskFile
from stlbench.task.gym_make import Gym, failed, made, modules, software, without_display
from stlbench.task.gym_spaces import ActionAxis, Expressions, Observed, action_axes, entries_of, numbers, outside_space

RenderMode: TypeAlias = Literal["rgb_array"] | None
"""Whether a copy renders pictures."""

SignalsOf: TypeAlias = Callable[[Any, Mapping[str, Any]], Sequence[float] | None]
"""Observation and info of one copy -> the k signals; None if expressions give them."""


class GymSource:
    """One kind of environment: how copies are made, and how they are read. It lends copies and takes them back."""

    def __init__(
        self,
        make: Callable[[RenderMode], Gym],
        entry: Environment,
        texts: Mapping[str, str],
        signals: SignalsOf | None = None,
    ) -> None:
        """Makes one copy, to read its spaces.

        Args:
            make: makes a copy, without a time limit.
            entry: the task file's `environment`, with the names and scales of the observation's entries.
            texts: signal -> expression over named entries of the observation and over entries of the info.
            signals: a function in place of the expressions.

        Raises:
            UsageError: it cannot be made, or names, expressions, scale or actions do not fit it.
        """
        self._make, self.signals = make, tuple(texts)
        without_display()
        first = make(None)
        self._modes: Sequence[str] = first.metadata.get("render_modes") or ()
        if (space := getattr(first, "action_space", None)) is None:
            raise UsageError("environment: it has no action_space; set one in its __init__")
        self.action_space = space
        self.entries = entries_of(first.observation_space, entry.names)
        self._is_box = isinstance(first.observation_space, Box)  # its flat numbers are the named entries
        self.observed = Observed(first.observation_space, self.entries, entry.scale)
        self.software, self.modules = software(first), modules(first)
        self.function = signals
        self.expressions = Expressions({} if signals else texts, self.entries)
        self._idle: dict[bool, list[Gym]] = {False: [first], True: []}

    @property
    def axes(self) -> tuple[ActionAxis, ...]:
        """The numbers of an action. Raises `UsageError` if the action space is none of numbers."""
        return action_axes(self.action_space)

    def read(self, samples: Sequence[tuple[Any, Mapping[str, Any]]]) -> tuple[Array, Array]:
        """The flat observations (r, d), and the signals (r, k), of observations with their infos.

        Raises `UsageError` if an observation is outside its space, or a signal is missing.
        """
        try:
            seen = [self.observed.flat(observation) for observation, _ in samples]
            if wrong := {np.size(each) for each in seen} - {self.observed.size}:
                raise ValueError(f"{min(wrong)} numbers in place of {self.observed.size}")
            flat = np.array(seen, dtype=np.float64)
        except LookupError as error:
            raise outside_space(cause(error)) from error
        except (TypeError, ValueError) as error:
            raise outside_space(str(error)) from error
        if self.function is not None:
            return flat, np.stack([numbers(self.function(*sample), len(self.signals)) for sample in samples])
        named = flat if self.entries.names else flat[:, :0]
        if self.entries.names and not self._is_box:
            named = np.concatenate([self.entries.read(observation, 1) for observation, _ in samples])
        return flat, self.expressions.values(named, [info for _, info in samples])

    @cached_property
    def undrawn(self) -> str:
        """Why copies render no pictures, or nothing if they do. Makes one that does."""
        if "rgb_array" not in self._modes:
            return "the environment has no render mode rgb_array"
        try:
            self.give_back(self.borrow(1, drawn=True), drawn=True)
        except UsageError as error:
            return str(error)
        return ""

    def borrow(self, count: int, *, drawn: bool = False) -> list[Gym]:
        """That many copies, which `give_back` takes; `drawn` are those that render pictures."""
        idle = self._idle[drawn]
        taken, self._idle[drawn] = idle[:count], idle[count:]
        return taken + [self._drawn() if drawn else self._make(None) for _ in range(count - len(taken))]

    def _drawn(self) -> Gym:
        """A copy that has drawn a picture already. Raises `UsageError`."""
        copy = self._make("rgb_array")
        if copy.render_mode != "rgb_array":
            raise UsageError("it was not made with the render mode rgb_array; make() should pass on self.render_mode")
        try:
            copy.reset(seed=0)
            copy.render()
        except Exception as error:  # a driver and the library above it raise many kinds of errors
            raise UsageError(f"the environment cannot draw itself here: {cause(error)}") from error
        atexit.register(copy.close)  # after the first picture, so that it is done while what draws is still loaded
        return copy

    def give_back(self, copies: list[Gym], *, drawn: bool = False) -> None:
        """Takes copies back. They are lent once more, as a reset with a seed forgets what was before."""
        self._idle[drawn] += copies


_WITHOUT_ID = {"kwargs", "drawn", "api"}
"""Entries of `environment` without effect if a class makes it."""


def source_of(name: str, file: TaskFile, task: GymTask) -> GymSource:
    """The environment of a task. Makes one copy.

    Raises:
        UsageError: in one line, what cannot be made, or what of the file does not fit it.
    """
    entry, kind = file.environment or Environment(), type(task)
    texts = {name: signal.expression or name for name, signal in file.signals.items()}
    try:
        if kind.make is GymTask.make and kind.signals is GymTask.signals:
            source = _shared(_Shared(repr((entry, texts)), entry, texts))
        else:
            source = _of_class(entry, task, texts)
        _check_actions(file.actions, source.axes)
    except UsageError as error:
        raise UsageError(f"task {name}: {error}") from error
    return source


@dataclass(frozen=True)
class _Shared:
    """An entry and its expressions as they are, compared by how Python writes them: JSON has no infinity."""

    written: str
    entry: Environment = field(compare=False)
    texts: Mapping[str, str] = field(compare=False)


@lru_cache(maxsize=8)  # few, as each source keeps its copies
def _shared(by: _Shared) -> GymSource:
    """Sources by entry and expressions, so that tasks on one environment share its copies."""
    entry = by.entry.model_copy(deep=True)  # no environment changes what the task's file says
    return GymSource(partial(_by_id, entry), entry, by.texts)


def _of_class(entry: Environment, task: GymTask, texts: Mapping[str, str]) -> GymSource:
    if entry.id is None and (idle := sorted(entry.model_fields_set & _WITHOUT_ID)):
        raise UsageError(f"environment.{idle[0]}: there is no id that it could go with; make() makes the environment")
    function = None if type(task).signals is GymTask.signals else task.signals
    return GymSource(partial(_made, entry, task), entry, texts, function)


def _made(entry: Environment, task: GymTask, render_mode: RenderMode) -> Gym:
    maker = copy(task)
    maker.render_mode = render_mode
    try:
        env = maker.make()
    except UsageError:
        raise
    except Exception as error:
        raise failed("the environment", error) from error
    if not isinstance(env, gymnasium.Env | None):
        raise UsageError(f"make gives {type(env).__name__}, the contract says an environment of Gymnasium, or None")
    return _by_id(entry, render_mode) if env is None else env


def _by_id(entry: Environment, render_mode: RenderMode) -> Gym:
    if entry.id is None:
        raise UsageError("there is no environment: give its id in task.yaml, or a class of GymTask with make()")
    keywords = entry.kwargs if render_mode is None else entry.kwargs | entry.drawn | {"render_mode": render_mode}
    return made(entry.id, keywords, entry.api)


def _check_actions(declared: dict[str, Axis], axes: tuple[ActionAxis, ...]) -> None:
    if not declared:
        if all(axis.low == axis.high for axis in axes):
            raise UsageError("actions: the environment has none, or one value for each: there is nothing to choose")
        if not all(math.isfinite(axis.high - axis.low) for axis in axes):
            raise UsageError(
                "actions: those of the environment have no ends; `actions` in a task file gives each its low and high"
            )
        return
    if len(declared) != len(axes):
        raise UsageError(f"actions: {len(declared)} are declared, the environment has {len(axes)}")
    for (name, axis), own in zip(declared.items(), axes, strict=True):
        if own.values is not None and (axis.low, axis.high, axis.count) != (own.low, own.high, own.values):
            rule = f"low: {own.low:g}, high: {own.high:g}, count: {own.values}"
            raise UsageError(f"actions.{name}: the environment takes whole numbers, so it should be {{{rule}}}")
        with np.errstate(over="ignore"):  # in single precision, as most environments have their ends
            least, low, high, most = np.array([own.low, axis.low, axis.high, own.high]).astype(np.float32)
        if not (least <= low and axis.low < axis.high and high <= most):
            raise UsageError(
                f"actions.{name}: the environment takes {own.low:g} to {own.high:g}, got {axis.low:g} to {axis.high:g}"
            )
