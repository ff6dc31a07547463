"""The environment of a task: made, and checked against what the task file says of it."""

from __future__ import annotations

import json
import math
from functools import lru_cache, partial

from stlbench.contract import GymTask
from stlbench.environments.acting import ActionAxis
from stlbench.environments.making import Gym, made
from stlbench.environments.source import GymSource
from stlbench.errors import UsageError
from stlbench.task.file import Axis, TaskFile

__all__ = ["source_of"]


def source_of(name: str, file: TaskFile, task: GymTask) -> GymSource:
    """The environment of a task. Makes one copy.

    Raises:
        UsageError: in one line, what cannot be made, or what of the file does not fit it.
    """
    try:
        source = _of_class(file, task) if _is_written(task) else _of_file(*_content(file))
        _check_actions(file.actions, source.axes)
    except UsageError as error:
        raise UsageError(f"task {name}: {error}") from error
    return source


def _is_written(task: GymTask) -> bool:
    """Whether a class has something of its own that copies are made or read with."""
    kind = type(task)
    return kind.make is not GymTask.make or kind.signals is not GymTask.signals


def _of_class(file: TaskFile, task: GymTask) -> GymSource:
    _, _, texts, names, scale = _content(file)
    function = None if type(task).signals is GymTask.signals else task.signals
    return GymSource(partial(_made, file, task), json.loads(texts), json.loads(names), json.loads(scale), function)


def _made(file: TaskFile, task: GymTask) -> Gym:
    env = task.make()
    if env is not None:
        return env
    if file.environment is None:
        raise UsageError("there is no environment: give its id in task.yaml, or a class of GymTask with make()")
    return made(file.environment.id, file.environment.kwargs)


def _content(file: TaskFile) -> tuple[str, str, str, str, str]:
    """Id, keywords, expressions, names and scale: what copies are made and read with, as values that are compared."""
    texts = {name: signal.expression or name for name, signal in file.signals.items()}
    if file.environment is None:
        return "", "{}", json.dumps(texts), "null", "{}"
    entry = file.environment
    parts = entry.kwargs, texts, entry.names, entry.scale
    keywords, written, names, scale = map(json.dumps, parts)
    return entry.id, keywords, written, names, scale


@lru_cache(maxsize=8)
def _of_file(identifier: str, keywords: str, texts: str, names: str, scale: str) -> GymSource:
    """The tasks of a process that differ in other things share their copies."""
    if not identifier:
        raise UsageError("there is no environment: give its id in task.yaml, or a class of GymTask with make()")
    make = partial(made, identifier, json.loads(keywords))
    return GymSource(make, json.loads(texts), json.loads(names), json.loads(scale))


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
