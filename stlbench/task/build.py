"""Builds the method or agent that a user chose, for a task."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from typing import cast

from stlbench.contract import Agent, Intractable, RewardMethod, Specification, Unsuitable, cause
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, choice_of
from stlbench.task.task import Task


def build_method(task: Task | Specification, choice: Choice | str) -> RewardMethod:
    """The chosen method, with its parameters, for a task, or for a specification alone.

    Raises `Intractable`, `Unsuitable`, `UsageError`; `ValueError` unless `scale` is positive and finite, `floor`
    finite, and sizes at least 0.
    """
    given = task if isinstance(task, Specification) else task.specification
    method = cast(RewardMethod, plugins.build("methods", choice_of(choice), given))
    if not (math.isfinite(method.scale) and method.scale > 0):
        raise ValueError(f"method {choice}: its scale should be finite and more than 0, it is {method.scale}")
    if not math.isfinite(method.floor):
        raise ValueError(f"method {choice}: its floor should be finite, it is {method.floor}")
    for name, size in (("memory_size", method.memory_size), ("input_size", method.input_size)):
        if size < 0:
            raise ValueError(f"method {choice}: its {name} should be at least 0, it is {size}")
    return method


def fitting_methods(
    task: Task | Specification, choices: Iterable[Choice | str] | None = None
) -> dict[str, RewardMethod]:
    """Those of the chosen methods, else of all installed, that can be built, by the text of the choice.

    A `PluginWarning` names one that raises what the contract does not name.
    """
    methods = dict[str, RewardMethod]()
    name = task.formula if isinstance(task, Specification) else f"task {task.name}"
    for choice in plugins.available("methods") if choices is None else choices:
        try:
            methods[str(choice)] = build_method(task, choice)
        except (Intractable, Unsuitable, UsageError):
            continue
        except Exception as error:
            message = f"method {choice} cannot be built for {name}: {cause(error)}"
            warnings.warn(message, plugins.PluginWarning, stacklevel=2)
    return methods


INIT = "init"
"""Of the choice of an agent, and no parameter of its constructor: the hash of the policy that it starts from."""


def build_agent(task: Task, choice: Choice | str) -> Agent:
    """The chosen agent with the task's recipe, or its defaults; the parameters of the choice override both.

    Raises `UsageError`, and `Unsuitable` where the agent cannot train on this machine.
    """
    choice = choice_of(choice).without(INIT)
    return cast(Agent, plugins.build("agents", choice, defaults=task.recipe(choice.name)))
