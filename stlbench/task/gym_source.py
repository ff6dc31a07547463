"""The environment of a task: made, checked against the task file, and read; where its copies come from."""

from __future__ import annotations

import atexit
import json
import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import cached_property, lru_cache, partial
from typing import Any, Literal, TypeAlias

from stlbench.contract import GymTask, cause
from stlbench.errors import UsageError
from stlbench.task.file import Axis, Environment, TaskFile
from stlbench.task.gym_joint import parallel
from stlbench.task.gym_make import Gym, failed, made, modules, software
from stlbench.task.gym_signals import Expressions
from stlbench.task.gym_spaces import ActionAxis, Names, Observed, action_axes, entries_of

RenderMode: TypeAlias = Literal["rgb_array"] | None
"""Whether a copy renders pictures."""

SignalsOf: TypeAlias = Callable[[Any, Mapping[str, Any]], Sequence[float] | None]
"""Observation and info of one copy -> the k signals; None where expressions give them."""


class GymSource:
    """One kind of environment: how copies are made, and how they are read. It lends copies and takes them back."""

    def __init__(
        self,
        make: Callable[[RenderMode], Gym],
        texts: Mapping[str, str],
        names: Names | None = None,
        scale: Mapping[str, float] | None = None,
        signals: SignalsOf | None = None,
    ) -> None:
        """Makes one copy, to read its spaces.

        Args:
            make: makes a copy, without a time limit.
            texts: signal -> expression over named entries of the observation and over entries of the info.
            names: of the entries of the observation (`entries`).
            scale: named entry -> about its largest magnitude, where its space has no ends.
            signals: in place of the expressions.

        Raises:
            UsageError: it cannot be made, or names, expressions, scale or actions do not fit it.
        """
        self._make, self.signals = make, tuple(texts)
        if sys.platform == "linux" and not os.environ.get("DISPLAY"):
            os.environ.setdefault("MUJOCO_GL", "egl")  # before it is imported: its own choice needs a display
        first = make(None)
        self._modes: Sequence[str] = first.metadata.get("render_modes") or ()
        self.action_space = first.action_space
        self.entries = entries_of(first.observation_space, names)
        self.observed = Observed(first.observation_space, self.entries, scale or {})
        self.software, self.modules = software(first), modules(first)
        self.function = signals
        self.expressions = Expressions({} if signals else texts, self.entries)
        self._idle: dict[bool, list[Gym]] = {False: [first], True: []}

    @property
    def axes(self) -> tuple[ActionAxis, ...]:
        """The numbers of an action. Raises `UsageError` where the action space is none of numbers."""
        return action_axes(self.action_space)

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
        except Exception as error:  # of the driver, and of the library above it, there are many kinds
            raise UsageError(f"the environment cannot draw itself here: {cause(error)}") from error
        atexit.register(copy.close)  # after the first picture, so that it is done while what draws is still loaded
        return copy

    def give_back(self, copies: list[Gym], *, drawn: bool = False) -> None:
        """Takes copies back. They are lent once more, as a reset with a seed forgets what was before."""
        self._idle[drawn] += copies


_NONE = "there is no environment: give its id in task.yaml, or a class of GymTask with make()"
_WITHOUT_ID = {"kwargs", "drawn", "api"}
"""Entries of `environment` without effect where a class makes it."""


def source_of(name: str, file: TaskFile, task: GymTask) -> GymSource:
    """The environment of a task. Makes one copy.

    Raises:
        UsageError: in one line, what cannot be made, or what of the file does not fit it.
    """
    try:
        source = _of_class(file, task) if _is_written(task) else _of_file(file)
        _check_actions(file.actions, source.axes)
    except UsageError as error:
        raise UsageError(f"task {name}: {error}") from error
    return source


def _is_written(task: GymTask) -> bool:
    kind = type(task)
    return kind.make is not GymTask.make or kind.signals is not GymTask.signals


def _of_class(file: TaskFile, task: GymTask) -> GymSource:
    entry = file.environment or Environment()
    if entry.id is None and (idle := sorted(entry.model_fields_set & _WITHOUT_ID)):
        raise UsageError(f"environment.{idle[0]}: there is no id that it could go with; make() makes the environment")
    function = None if type(task).signals is GymTask.signals else task.signals
    return GymSource(partial(_made, file, task), _expressions(file), entry.names, entry.scale, function)


def _of_file(file: TaskFile) -> GymSource:
    if file.environment is None or file.environment.id is None:
        raise UsageError(_NONE)
    return _of_text(file.environment.model_dump_json(), json.dumps(_expressions(file)))


def _made(file: TaskFile, task: GymTask, render_mode: RenderMode) -> Gym:
    maker = copy(task)
    maker.render_mode = render_mode
    try:
        env = maker.make()
    except UsageError:
        raise
    except Exception as error:
        raise failed("the environment", error) from error
    if env is not None:
        return env
    if file.environment is None or file.environment.id is None:
        raise UsageError(_NONE)
    return _by_id(file.environment, render_mode)


def _by_id(entry: Environment, render_mode: RenderMode) -> Gym:
    assert entry.id is not None
    keywords = entry.kwargs if render_mode is None else entry.kwargs | entry.drawn | {"render_mode": render_mode}
    return (made if entry.api == "gymnasium" else parallel)(entry.id, keywords)


def _expressions(file: TaskFile) -> dict[str, str]:
    return {name: signal.expression or name for name, signal in file.signals.items()}


@lru_cache(maxsize=8)
def _of_text(environment: str, texts: str) -> GymSource:
    """By the JSON of the entry and of the expressions, so that tasks on one environment share its copies."""
    entry = Environment.model_validate_json(environment)
    return GymSource(partial(_by_id, entry), json.loads(texts), entry.names, entry.scale)


def _check_actions(declared: dict[str, Axis], axes: tuple[ActionAxis, ...]) -> None:
    if not declared:
        if not all(math.isfinite(axis.high - axis.low) for axis in axes):
            raise UsageError("actions: those of the environment have no ends; give each with its low and high")
        return
    if len(declared) != len(axes):
        raise UsageError(f"actions: {len(declared)} are declared, the environment has {len(axes)}")
    for (name, axis), own in zip(declared.items(), axes, strict=True):
        if own.values is not None and (axis.low, axis.high, axis.count) != (own.low, own.high, own.values):
            rule = f"low: {own.low:g}, high: {own.high:g}, count: {own.values}"
            raise UsageError(f"actions.{name}: the environment takes whole numbers, so it should be {{{rule}}}")
        if not own.low <= axis.low < axis.high <= own.high:
            raise UsageError(
                f"actions.{name}: the environment takes {own.low:g} to {own.high:g}, got {axis.low:g} to {axis.high:g}"
            )
