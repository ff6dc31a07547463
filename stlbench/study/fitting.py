"""Whether a method fits a task: it is built as for a run, asked for nothing, and must not make training too dear.

`docs/performance.md` has the measurements behind the two limits.
"""

from contextlib import suppress
from dataclasses import dataclass
from typing import Literal

from stlbench.contract import Agent, Cost, Intractable, RewardMethod, Specification, Unsuitable
from stlbench.errors import UsageError, cause, one_line
from stlbench.registry.plugins import PluginError
from stlbench.simulation.worlds import size_without
from stlbench.task import build_agent, build_method
from stlbench.task.task import Task

REPLAY_LIMIT = 4.0  # GiB that an agent's replay may take: two cells at a time then fit into a laptop of 16 GiB
UPDATE_LIMIT = 10.0  # how many times as long as without the method's inputs an update may take
_GIB = 2**30


def refuse_dear(task: Task, method: RewardMethod, agent: Agent, steps: int) -> None:
    """Refuse to train where the method's inputs make the replay or an update larger than the limits, for this budget.

    Raises:
        Intractable: "needs 4002 inputs: a replay of 1.96 GiB (limit 4), updates 16 times as long (limit 10)".
    """
    if not method.input_size:
        return
    size, decisions = size_without(task), max(1, steps // task.file.hold)
    cost = agent.cost(size + method.input_size, task.actions, decisions)
    without = agent.cost(size, task.actions, decisions)
    if cost is None or without is None:
        return
    if not (isinstance(cost, Cost) and isinstance(without, Cost)):
        raise TypeError(f"cost of {type(agent).__name__} gives {type(cost).__name__}, the contract says Cost or None")
    replay, longer = cost.replay / _GIB, cost.update / without.update
    if replay > REPLAY_LIMIT or longer > UPDATE_LIMIT:
        raise Intractable(
            f"needs {method.input_size} inputs: a replay of {replay:.2f} GiB (limit {REPLAY_LIMIT:g}), "
            f"updates {longer:.0f} times as long (limit {UPDATE_LIMIT:g})"
        )


@dataclass(frozen=True)
class Fit:
    """A method that was built for a task, or why it was not."""

    status: Literal["suitable", "unsuitable", "intractable", "raised"]
    method: RewardMethod | None = None
    reason: str = ""


def fit(task: Task | Specification, choice: str) -> Fit:
    """Build a method for a task, as a run does for its own agent and largest budget, or for a formula alone.

    Raises `PluginError` if it cannot be loaded.
    """
    try:
        method = build_method(task, choice)
        if not isinstance(task, Specification):
            with suppress(Unsuitable, UsageError):  # where the task's own agent cannot be built here
                agent, budgets = build_agent(task, task.own_agent), task.file.budgets.values()
                refuse_dear(task, method, agent, max(budget.steps for budget in budgets))
    except PluginError:
        raise
    except Intractable as reason:
        return Fit("intractable", reason=one_line(reason))
    except (Unsuitable, UsageError) as reason:
        return Fit("unsuitable", reason=one_line(reason))
    except Exception as error:
        return Fit("raised", reason=cause(error))
    return Fit("suitable", method)
