"""The environment of a task: made, and checked against what the task file says of it."""

from __future__ import annotations

import json
import math
from copy import copy
from functools import lru_cache, partial

from stlbench.contract import GymTask
from stlbench.errors import UsageError
from stlbench.task.acting import ActionAxis
from stlbench.task.file import Axis, Environment, TaskFile
from stlbench.task.joint import parallel
from stlbench.task.making import Gym, failed, made
from stlbench.task.source import GymSource, RenderMode

_NONE = "there is no environment: give its id in task.yaml, or a class of GymTask with make()"
_WITHOUT_ID = {"kwargs", "drawn", "api"}
"""What of `environment` says nothing where a class makes the environment."""


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
    """Whether a class has something of its own that copies are made or read with."""
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
    """By JSON of the entry and of the expressions: tasks that differ in other things share their copies."""
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
