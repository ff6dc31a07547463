"""Tasks x methods x agents x seeds: the cells of a study, each with its identity and a key for the ledger."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from stlbench.contract import Unsuitable
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.registry.fingerprint import fingerprint
from stlbench.result import FORMAT, CellId, Measurement, Result, Status
from stlbench.task import build_agent, load_task
from stlbench.task.task import Task

__all__ = ["Cell", "check_cells", "derive_seed", "plan_cells", "uncompiled"]


_NO_PART = {"title", "source", "notes", "plane", "best_possible", "agents", "budgets"}
"""What a task file says that changes no result, or is in the key of a cell by itself."""


@dataclass(frozen=True)
class Cell:
    """One training run and its evaluation."""

    id: CellId
    key: str
    """Hash (32 hex digits) of all that can change the result, and of nothing else."""
    deadline: float
    """Wall seconds after which it is stopped."""

    def ended(
        self, status: Status, reason: str = "", details: str = "", measurement: Measurement | None = None
    ) -> Result:
        """The result of this cell, without provenance."""
        return Result(self.id, self.key, status, reason, details, measurement)


def plan_cells(
    tasks: Iterable[Choice],
    methods: Iterable[Choice],
    agents: Iterable[Choice] | None,
    seeds: Sequence[int] | None,
    budget: str,
) -> tuple[Cell, ...]:
    """All cells of a study, the first seed of everything first.

    No method or agent is imported, so that a study that is already done is answered at once; see `check_cells`.

    Args:
        tasks: tasks, or ablations of them (`load_task`).
        methods: what to compare.
        agents: what to train with, by a task's recipe or else by its defaults. None for the first that each task has
            a recipe for.
        seeds: which; None for 0..n-1 with the number n that the task's budget names.
        budget: name of a budget that each task has.

    Raises:
        UsageError: no seed, an unknown name, a task with errors, or without the budget.
    """
    if seeds is not None and (not seeds or min(seeds) < 0):
        raise UsageError(f"at least one seed is needed, none of them negative, got {list(seeds)}")
    keyed_methods = {method: _choice_part("methods", method) for method in methods}
    chosen_agents = None if agents is None else tuple(agents)
    planned = [_Planned.of(load_task(choice), chosen_agents, seeds, budget) for choice in dict.fromkeys(tasks)]
    cells = []
    every_seed = sorted(set().union(*(task.seeds for task in planned)))
    for seed, task, (method, method_part) in product(every_seed, planned, keyed_methods.items()):
        if seed in task.seeds:
            for agent, recipe in task.agents.items():
                key = _digest([FORMAT, task.part, method_part, recipe, seed])
                cells.append(Cell(CellId(task.task, method, agent, seed, budget), key, task.deadline))
    return tuple(cells)


@dataclass(frozen=True)
class _Planned:
    """One task's share of a study."""

    task: Choice
    seeds: Sequence[int]
    deadline: float
    part: str
    """What of the task is in the keys of its cells."""
    agents: dict[Choice, str]
    """With what of each is in the keys."""

    @classmethod
    def of(cls, task: Task, agents: Sequence[Choice] | None, seeds: Sequence[int] | None, name: str) -> _Planned:
        budget = task.budget(name)
        parts = {agent: _agent_part(task, agent) for agent in agents or (Choice(task.own_agent),)}
        return cls(task.choice, seeds or range(budget.seeds), budget.deadline, _task_part(task, name), parts)


def check_cells(cells: Iterable[Cell]) -> tuple[str, ...]:
    """Load the methods and agents of these cells and check their parameters, before any of them runs.

    Returns:
        A line for each thing that the user should know: an agent that trains with its defaults.

    Raises:
        UsageError: the first wrong parameter, plugin that cannot be loaded, or agent that cannot train here.
    """
    ids, notes = [cell.id for cell in cells], list[str]()
    for method in dict.fromkeys(cell.method for cell in ids):
        plugins.check("methods", method)
    for name, agent in dict.fromkeys((cell.task, cell.agent) for cell in ids):
        task = load_task(name)
        _check_agent(task, agent)
        if agent.name not in task.file.agents:
            notes.append(f"task {name} has no recipe for agent {agent}, which trains with its defaults")
    return tuple(notes)


def uncompiled(cells: Iterable[Cell]) -> Iterator[tuple[Choice, Callable[[], None]]]:
    """Agents of these cells whose code this machine has not compiled, and what compiles it.

    Otherwise each worker would compile it at the same time, in its first cell.
    """
    for task, agent in dict.fromkeys((cell.id.task, cell.id.agent) for cell in cells):
        work = build_agent(load_task(task), agent).uncompiled()
        if work is not None:
            yield agent, work


def _check_agent(task: Task, agent: Choice) -> None:
    try:
        build_agent(task, agent)
    except UsageError:
        raise
    except Exception as error:
        cause = str(error) if isinstance(error, Unsuitable) else f"{type(error).__name__}: {error}"
        raise UsageError(f"agent {agent}: {' '.join(cause.split())}") from error


def derive_seed(*parts: str | int) -> int:
    """A seed in 0..2^63-1 from what it is for: derive_seed("starts", "hold-disc", 3).

    Leave the method out of the parts, and every method gets the same random numbers: comparisons are paired.
    """
    return int.from_bytes(hashlib.sha256(json.dumps(parts).encode()).digest()[:8], "big") >> 1


def _task_part(task: Task, budget: str) -> str:
    """Words and pictures for people change no result, nor do other budgets, deadlines, recipes of other agents."""
    content = task.file.model_dump(mode="json", exclude=_NO_PART)
    numbers = task.budget(budget).model_dump(mode="json", include={"steps", "checkpoints"})
    return _digest([task.choice.name, content, numbers, _plugin_part("tasks", task.choice.name)])


def _agent_part(task: Task, choice: Choice) -> str:
    return _digest([_choice_part("agents", choice), dict(task.recipe(choice.name))])


def _choice_part(kind: str, choice: Choice) -> str:
    return _digest([str(choice), _plugin_part(kind, choice.name)])


def _plugin_part(kind: str, name: str) -> list[str]:
    plugin = plugins.find(kind, name)
    return [plugin.distribution, plugin.version, fingerprint(plugin.entry_point.module)]


def _digest(parts: list[Any]) -> str:
    # Keys are not sorted: the order of signals, of states and of action axes has a meaning.
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]
