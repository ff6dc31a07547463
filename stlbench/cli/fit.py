"""Whether a reward method fits a task, and why not, as a run would find."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from stlbench.errors import UsageError, cause, one_line

if TYPE_CHECKING:
    from stlbench.contract import RewardMethod
    from stlbench.task.task import Task


@dataclass(frozen=True)
class Fit:
    """What became of a method on a task: the method, or status and reason."""

    status: Literal["suitable", "unsuitable", "intractable", "raised"]
    method: RewardMethod | None = None
    reason: str = ""


def fit(task: Task, choice: str) -> Fit:
    """Build a method for a task, by its name or with parameters.

    Raises `PluginError` where the method cannot be loaded.
    """
    from stlbench.contract import Intractable, Unsuitable
    from stlbench.registry import plugins
    from stlbench.task import build_method

    try:
        method = build_method(task, choice)
        _refuse_dear(task, method)
    except plugins.PluginError:
        raise
    except Intractable as reason:
        return Fit("intractable", reason=one_line(reason))
    except (Unsuitable, UsageError) as reason:
        return Fit("unsuitable", reason=one_line(reason))
    except Exception as error:
        return Fit("raised", reason=cause(error))
    return Fit("suitable", method)


def _refuse_dear(task: Task, method: RewardMethod) -> None:
    """As a run would, with the task's own agent and its largest budget, where that agent can be built here."""
    from stlbench.contract import Unsuitable
    from stlbench.rollout.cost import refuse_dear
    from stlbench.task import build_agent

    with suppress(Unsuitable, UsageError):
        agent = build_agent(task, task.own_agent)
        refuse_dear(task, method, agent, max(budget.steps for budget in task.file.budgets.values()))
