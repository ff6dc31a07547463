"""Whether a method fits a task: it is built as for a run, and asked for nothing."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from stlbench.contract import Intractable, RewardMethod, Specification, Unsuitable
from stlbench.errors import UsageError, cause, one_line
from stlbench.registry.plugins import PluginError
from stlbench.rollout.cost import refuse_dear
from stlbench.task import build_agent, build_method
from stlbench.task.task import Task


@dataclass(frozen=True)
class Fit:
    """A method that was built for a task, or why it was not."""

    status: Literal["suitable", "unsuitable", "intractable", "raised"]
    method: RewardMethod | None = None
    reason: str = ""


def fit(task: Task | Specification, choice: str) -> Fit:
    """Build a method for a task, as a run does, or for a formula alone. Raises `PluginError` if it cannot be loaded."""
    try:
        method = build_method(task, choice)
        if not isinstance(task, Specification):
            _refuse_dear(task, method)
    except PluginError:
        raise
    except Intractable as reason:
        return Fit("intractable", reason=one_line(reason))
    except (Unsuitable, UsageError) as reason:
        return Fit("unsuitable", reason=one_line(reason))
    except Exception as error:
        return Fit("raised", reason=cause(error))
    return Fit("suitable", method)


def _refuse_dear(task: Task, method: RewardMethod) -> None:
    """Refuse a slow method for the task's own agent and largest budget, if that agent can be built here."""
    with suppress(Unsuitable, UsageError):
        agent = build_agent(task, task.own_agent)
        refuse_dear(task, method, agent, max(budget.steps for budget in task.file.budgets.values()))
