"""Tasks x methods x agents x seeds: the cells of a study, each with its identity and a key for the ledger."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any

from stlbench.contract import GymTask, System, Unsuitable, cause
from stlbench.contract_parts.texts import one_line
from stlbench.errors import UsageError
from stlbench.registry import folders, plugins
from stlbench.registry.choices import Choice
from stlbench.registry.fingerprint import fingerprint
from stlbench.result import FORMAT, CellId, Measurement, Result, Status, Track
from stlbench.study.tracks import Recipe, Recipes, on_track
from stlbench.task import build_agent, load_task
from stlbench.task.task import Task

__all__ = ["Cell", "check_cells", "derive_seed", "plan_cells", "uncompiled"]


_NO_PART: dict[str, Any] = dict.fromkeys(
    ("title", "source", "notes", "plane", "best_possible", "agents", "budgets"), True
)
"""What a task file says that changes no result, or is in the key of a cell by itself."""
_NO_SYSTEM: dict[str, Any] = {"environment": True, "terminated": True, "signals": {"__all__": {"expression"}}}
"""What it says of environments alone."""


@dataclass(frozen=True)
class Cell:
    """One training run and its evaluation."""

    id: CellId
    key: str
    """Hash (32 hex digits) of all that can change the result, and of nothing else."""
    deadline: float
    """Wall seconds after which it is stopped."""
    recipe: Recipe | None = None
    """That of its method, on the track `tuned`."""
    folder: Path | None = None
    """Where its task is, for a task that is a folder."""

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
    track: Track = "shared",
    recipes: Recipes | None = None,
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
        track: by which rules they are trained.
        recipes: of the track `tuned`.

    Raises:
        UsageError: no seed, an unknown name, a task with errors, or without the budget; on the track `tuned` no recipe.
    """
    if seeds is not None and (not seeds or min(seeds) < 0):
        raise UsageError(f"at least one seed is needed, none of them negative, got {list(seeds)}")
    if (track == "tuned") != (recipes is not None):
        raise UsageError("track tuned, and no other, needs a file of recipes, as `stlbench tune` writes it")
    keyed = {method: _choice_part("methods", method) for method in methods}
    chosen = None if agents is None else tuple(agents)
    planned = [_Planned.of(load_task(choice), chosen, seeds, budget, track) for choice in dict.fromkeys(tasks)]
    every_seed = sorted(set().union(*(task.seeds for task in planned)))
    return tuple(
        task.cell(method, agent, seed, part, recipes)
        for seed, task, (method, part) in product(every_seed, planned, keyed.items())
        if seed in task.seeds
        for agent in task.agents
    )


@dataclass(frozen=True)
class _Planned:
    """One task's share of a study."""

    task: Task
    agents: Sequence[Choice]
    seeds: Sequence[int]
    budget: str
    track: Track

    @classmethod
    def of(
        cls, task: Task, agents: Sequence[Choice] | None, seeds: Sequence[int] | None, budget: str, track: Track
    ) -> _Planned:
        """Raises `UsageError` where the task has no such budget."""
        several = task.budget(budget).seeds
        return cls(task, agents or (Choice(task.own_agent),), seeds or range(several), budget, track)

    def cell(self, method: Choice, agent: Choice, seed: int, method_part: str, recipes: Recipes | None) -> Cell:
        recipe = recipes.of(self.task.choice, agent, method) if recipes else None
        task_part, agent_part = self._parts(agent, recipe)
        key = _digest([FORMAT, self.track, task_part, method_part, agent_part, seed])
        cell = CellId(self.task.choice, method, agent, seed, self.budget, self.track)
        place = folders.place_of(self.task.choice.name)
        return Cell(cell, key, self.task.budget(self.budget).deadline, recipe, place)

    def _parts(self, agent: Choice, recipe: Recipe | None) -> tuple[str, str]:
        """What of the task, and of the agent and its recipe, is in the keys of its cells."""
        name = agent, None if recipe is None else (tuple(recipe.agent.items()), recipe.hold)
        if name not in self._known:
            task = on_track(self.task, agent, self.track, recipe)
            self._known[name] = (_task_part(task, self.budget), _agent_part(task, agent))
        return self._known[name]

    @cached_property
    def _known(self) -> dict[Any, tuple[str, str]]:
        """Those that were asked for: a seed changes nothing of them."""
        return {}


def check_cells(cells: Iterable[Cell]) -> tuple[str, ...]:
    """Load the methods and agents of these cells and check their parameters, before any of them runs.

    Returns:
        A line for each thing that the user should know: an agent that trains with its defaults.

    Raises:
        UsageError: the first wrong parameter, plugin that cannot be loaded, or agent that cannot train here.
    """
    planned, notes = tuple(cells), dict[str, None]()
    for method in dict.fromkeys(cell.id.method for cell in planned):
        plugins.check("methods", method)
    for cell, task in _trainings(planned):
        agent = cell.id.agent
        _check_agent(on_track(task, agent, cell.id.track, cell.recipe), agent)
        if agent.name not in task.file.agents and cell.id.track != "plain":
            notes[f"task {cell.id.task} has no recipe for agent {agent}, which trains with its defaults"] = None
    return tuple(notes)


def _trainings(cells: Iterable[Cell]) -> Iterator[tuple[Cell, Task]]:
    """One of the cells that train a task alike, whatever the method and the seed, and the task as its file says."""
    alike = {(cell.id.task, cell.id.agent, cell.id.track, str(cell.recipe)): cell for cell in cells}
    for cell in alike.values():
        yield cell, load_task(cell.id.task)


def uncompiled(cells: Iterable[Cell]) -> Iterator[tuple[Choice, Callable[[], None]]]:
    """Agents of these cells whose code this machine has not compiled, and what compiles it.

    Otherwise each worker would compile it at the same time, in its first cell.
    """
    for cell, task in _trainings(cells):
        agent = cell.id.agent
        work = build_agent(on_track(task, agent, cell.id.track, cell.recipe), agent).uncompiled()
        if work is not None:
            yield agent, work


def _check_agent(task: Task, agent: Choice) -> None:
    try:
        build_agent(task, agent)
    except UsageError:
        raise
    except Exception as error:
        said = one_line(error) if isinstance(error, Unsuitable) else cause(error)
        raise UsageError(f"agent {agent}: {said}") from error


def derive_seed(*parts: str | int) -> int:
    """A seed in 0..2^63-1 from what it is for: derive_seed("starts", "hold-disc", 3).

    Leave the method out of the parts, and every method gets the same random numbers: comparisons are paired.
    """
    return int.from_bytes(hashlib.sha256(json.dumps(parts).encode()).digest()[:8], "big") >> 1


def _task_part(task: Task, budget: str) -> str:
    """Words and pictures for people change no result, nor do other budgets, deadlines, recipes of other agents.

    The versions of the software of an environment belong to it.
    """
    left_out = _NO_PART | _NO_SYSTEM if isinstance(task.dynamics, System) else _NO_PART
    content = task.file.model_dump(mode="json", exclude=left_out)
    numbers = task.budget(budget).model_dump(mode="json", include={"steps", "checkpoints", "random_starts"})
    software = [task.source.software] if isinstance(task.dynamics, GymTask) else []
    return _digest([task.choice.name, content, numbers, _plugin_part("tasks", task.choice.name), *software])


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
