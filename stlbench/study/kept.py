"""A stored policy, ready to be used again: with its task, as its track has it, and its method."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple, cast

from stlbench.contract import Agent, Arrays, Intractable, Policy, RewardMethod, Unsuitable
from stlbench.errors import UsageError, cause
from stlbench.records.identity import CellId
from stlbench.records.result import Result, StoredPolicies
from stlbench.records.saved_policies import Which, read
from stlbench.registry import plugins
from stlbench.rollout.shown import observation_of
from stlbench.study.tracks import Recipe, on_track
from stlbench.task import Task, build_method, load_task


class Kept(NamedTuple):
    """What the referee needs to let a stored policy act: `record(kept.task, kept.method, kept.policy, states)`."""

    task: Task
    """As the cell's track and recipe have it."""
    method: RewardMethod
    """Gives the policy the inputs that it was trained with."""
    policy: Policy


def load_policy(folder: Path, result: Result, which: Which = "selected", on: Task | None = None) -> Kept:
    """The stored policy of a cell; it acts as it did when it was scored, bit for bit.

    A tuned recipe is not read again: what of it matters is in the result. Neither is a library that the agent trains
    with needed, unless its policies do.

    Args:
        folder: of results.
        result: of the cell, from that folder's ledger or its `cells.jsonl`.
        which: the checkpoint that was selected, or the policy at the end of training.
        on: another task than its own, with the same observation and the same actions; its own where left out.

    Raises:
        UsageError: no policy is stored, or it is not what was recorded; its task, method or agent is not installed, or
            gives other observations or takes other actions now than it did when the policy was trained.
    """
    arrays, name = read(folder, result, which), result.id.name
    assert result.measurement is not None
    assert result.measurement.policies is not None
    stored, cell = result.measurement.policies, result.id
    task = own_task(cell, stored) if on is None else on
    try:
        method = build_method(task, cell.method)
        policy = _restored(cell.agent.name, arrays, task)
    except (Intractable, Unsuitable) as error:
        raise UsageError(f"{name}: its policy cannot be used: {error}") from error
    _check(name, task, method, stored, cell)
    return Kept(task, method, policy)


def own_task(cell: CellId, stored: StoredPolicies) -> Task:
    """The task of a cell, as its track and recipe have it. Raises `UsageError` where it is not installed."""
    recipe = Recipe(stored.agent, stored.hold) if cell.track == "tuned" else None
    return on_track(load_task(cell.task), cell.agent, cell.track, recipe)


def _restored(agent: str, arrays: Arrays, task: Task) -> Policy:
    plugin = plugins.find("agents", agent)
    kind = cast(type[Agent], plugin.load())
    try:
        return kind.restore(arrays, task.actions)
    except Unsuitable:
        raise
    except Exception as error:
        raise Unsuitable(f"{plugin} cannot restore it: {cause(error)}") from error


def _check(name: str, task: Task, method: RewardMethod, stored: StoredPolicies, cell: CellId) -> None:
    """Networks do not check what they are given; some would read what lies beside it in memory."""
    shown = observation_of(task, method, str(cell.method))
    if shown.total != stored.observation_size:
        rule = f"acts on {stored.observation_size} numbers, and task {task.name} shows {shown.total}"
        raise UsageError(f"{name}: its policy {rule}; it is another task, or one was changed since it was trained")
    if stored.observation is not None:
        stored.observation.check(name, shown)
    elif task.choice != cell.task:
        own = own_task(cell, stored)
        observation_of(own, build_method(own, cell.method), str(cell.method)).check(name, shown)
