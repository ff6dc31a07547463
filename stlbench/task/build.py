"""From a user's choice to the method or agent it names, made for a task."""

from __future__ import annotations

from typing import cast

from stlbench.contract import Agent, Intractable, RewardMethod
from stlbench.registry import plugins
from stlbench.registry.choices import parse_choice
from stlbench.task.task import Task

__all__ = ["build_agent", "build_method"]


def build_method(task: Task, text: str) -> RewardMethod:
    """The method named `text`, with its parameters, for a task. Raises `Intractable`, `Unsuitable`, `UsageError`."""
    method = cast(RewardMethod, plugins.build("methods", parse_choice(text), task.specification))
    limit = task.specification.input_limit
    if method.memory_size > limit:
        raise Intractable(f"needs {method.memory_size} inputs, limit {limit}")
    return method


def build_agent(task: Task, text: str) -> Agent:
    """The agent named `text` with the task's recipe, which parameters in the text override."""
    choice = parse_choice(text)
    return cast(Agent, plugins.build("agents", choice, defaults=task.recipe(choice.name)))
