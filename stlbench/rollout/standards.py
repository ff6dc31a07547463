"""What the policies of a task are compared with: its controller by hand, and the best that is possible."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from stlbench.errors import UsageError
from stlbench.registry.choices import Choice
from stlbench.result import Score
from stlbench.rollout import controller
from stlbench.task import load_task
from stlbench.task.file import BestPossible

__all__ = ["Standard", "standards"]


@dataclass(frozen=True)
class Standard:
    """Of one task; an ablation has that of the task that it is one of."""

    by_hand: Score | None = None
    """The score of its controller, from the report's starts; None without one."""
    best_possible: BestPossible | None = None
    """As the task file says; None where it says nothing."""
    own_agent: str | None = None
    """The agent that the task is trained with unless another is named; None where nobody knows."""


def standards(tasks: Iterable[Choice]) -> dict[str, Standard]:
    """Name of a task -> what its policies are compared with, each once, in the order given.

    Left out are tasks that are not installed or cannot be loaded: results may come from another machine. Some seconds
    for a task on a MuJoCo model, whose controller is run.
    """
    found = dict[str, Standard]()
    for name in dict.fromkeys(task.name for task in tasks):
        try:
            task = load_task(Choice(name))
        except (UsageError, ImportError):
            continue
        except Exception as error:
            controller.warn(name, error)
            continue
        found[name] = Standard(controller.score(task), task.file.best_possible, task.own_agent)
    return found
