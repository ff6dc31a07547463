"""Tasks x methods x agents x seeds: the cells, each with a name for people and a key for the ledger."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, parse_choice
from stlbench.registry.fingerprint import fingerprint
from stlbench.result import FORMAT, Measurement, Result, Status
from stlbench.task import load_task
from stlbench.task.task import Task

__all__ = ["Cell", "check", "derive_seed", "plan"]


@dataclass(frozen=True)
class Cell:
    """One training run and its evaluation."""

    task: str
    """Canonical text of the choice: overlap, or overlap[without=cuts]."""
    method: str
    """Canonical text of the choice: funnel[ginf=0.02,variant=code]."""
    agent: str
    """Canonical text of the choice."""
    seed: int
    budget: str
    key: str
    """Hash (32 hex digits) of all that can change the result, and of nothing else."""

    @property
    def name(self) -> str:
        """The cell's human name: hold-disc/funnel/dqn/0."""
        return f"{self.task}/{self.method}/{self.agent}/{self.seed}"

    def ended(
        self, status: Status, reason: str = "", details: str = "", measurement: Measurement | None = None
    ) -> Result:
        """The result of this cell, without provenance."""
        return Result(
            key=self.key,
            task=self.task,
            method=self.method,
            agent=self.agent,
            seed=self.seed,
            budget=self.budget,
            status=status,
            reason=reason,
            details=details,
            measurement=measurement,
        )


def plan(
    tasks: Sequence[str],
    methods: Sequence[Choice],
    agents: Sequence[Choice] | None,
    seeds: Sequence[int] | None,
    budget: str,
) -> tuple[Cell, ...]:
    """All cells of a comparison, the first seed of everything first.

    No method or agent is imported, so that a run that is already done is answered at once; see `check`.

    Args:
        tasks: names of tasks, or ablations of them (`load_task`).
        methods: what to compare.
        agents: what to train with; each task has a recipe for it. None for the first that each task has a recipe for.
        seeds: which; None for 0..n-1 with the number n that the task's budget names.
        budget: name of a budget that each task has.

    Raises:
        UsageError: no seed, an unknown name, a task with errors, or without the budget or a recipe for an agent.
    """
    if seeds is not None and (not seeds or min(seeds) < 0):
        raise UsageError(f"at least one seed is needed, none of them negative, got {list(seeds)}")
    problems = [load_task(name) for name in dict.fromkeys(tasks)]
    wanted = {entry.name: seeds or range(entry.budget(budget).seeds) for entry in problems}
    method_parts = {str(choice): _choice_part("methods", choice) for choice in methods}
    task_parts = {entry.name: _task_part(entry, budget) for entry in problems}
    agent_parts = {
        entry.name: {str(choice): _agent_part(entry, choice) for choice in agents or (Choice(entry.own_agent),)}
        for entry in problems
    }
    cells = []
    for seed, (task, own), (method, part) in product(
        sorted(set().union(*wanted.values())), wanted.items(), method_parts.items()
    ):
        if seed in own:
            for agent, recipe in agent_parts[task].items():
                key = _digest([FORMAT, task_parts[task], part, recipe, seed])
                cells.append(Cell(task, method, agent, seed, budget, key))
    return tuple(cells)


def check(cells: Iterable[Cell]) -> None:
    """Load the methods and agents of these cells and check their parameters, before any of them runs.

    Raises:
        UsageError: the first wrong parameter, or plugin that cannot be loaded.
    """
    cells = tuple(cells)
    for method in dict.fromkeys(cell.method for cell in cells):
        plugins.check("methods", parse_choice(method))
    for task, agent in dict.fromkeys((cell.task, cell.agent) for cell in cells):
        choice = parse_choice(agent)
        plugins.check("agents", choice, load_task(task).recipe(choice.name))


def derive_seed(*parts: str | int) -> int:
    """A seed in 0..2^63-1 from what it is for: derive_seed("starts", "hold-disc", 3).

    Leave the method out of the parts, and every method gets the same random numbers: comparisons are paired.
    """
    return int.from_bytes(hashlib.sha256(json.dumps(parts).encode()).digest()[:8], "big") >> 1


def _task_part(entry: Task, budget: str) -> str:
    """Words and pictures for people change no result, nor do other budgets, deadlines, recipes of other agents."""
    content = entry.file.model_dump(mode="json", exclude={"title", "source", "notes", "plane", "agents", "budgets"})
    numbers = entry.budget(budget).model_dump(mode="json", include={"steps", "checkpoints"})
    return _digest([entry.plugin, content, numbers, _plugin_part("tasks", entry.plugin)])


def _agent_part(entry: Task, choice: Choice) -> str:
    return _digest([_choice_part("agents", choice), dict(entry.recipe(choice.name))])


def _choice_part(kind: str, choice: Choice) -> str:
    return _digest([str(choice), _plugin_part(kind, choice.name)])


def _plugin_part(kind: str, name: str) -> list[str]:
    plugin = plugins.find(kind, name)
    return [plugin.distribution, plugin.version, fingerprint(plugin.entry_point.module)]


def _digest(parts: list[Any]) -> str:
    # Keys are not sorted: the order of signals, of states and of action axes has a meaning.
    return hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:32]
