"""By which rules cells are trained (`result.Track`), and what each track makes of a task."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import yaml
from pydantic import ConfigDict, TypeAdapter, ValidationError

from stlbench.errors import UsageError, one_line
from stlbench.records.fields import first_problem
from stlbench.records.identity import CellId, Track
from stlbench.records.outputs import write
from stlbench.registry.choices import Choice
from stlbench.rollout.auto import for_every_method
from stlbench.task.entry import Count
from stlbench.task.task import Task, agent_for, load_task
from stlbench.task.yaml_text import load_yaml


@dataclass(frozen=True)
class Recipe:
    """The values that tuning chose for one method on one task, in place of a part of the shared recipe."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    agent: Mapping[str, str | int | float | bool] = field(default_factory=dict)  # parameters of the agent
    hold: Count | None = None  # steps for which an action is held; the task's own where None


_Found = Mapping[str, Mapping[str, Mapping[str, Recipe]]]
"""Task -> agent -> method -> recipe, by the texts of their choices."""


@dataclass(frozen=True)
class Recipes:
    found: _Found
    source: str  # the file, for messages

    def of(self, task: Choice, agent: Choice, method: Choice) -> Recipe:
        """The recipe of a method. Raises `UsageError` if there is none."""
        try:
            return self.found[str(task)][str(agent)][str(method)]
        except KeyError:
            what = f"{method} on {task} with {agent}"
            raise UsageError(f"{self.source} has no recipe for {what}; `stlbench tune` finds one") from None


def read_recipes(path: Path) -> Recipes:
    """The recipes of a file that `stlbench tune` wrote. Raises `UsageError` with the entry that is wrong."""
    try:
        recipes = load_yaml(path.read_text(encoding="utf-8"), str(path))["recipes"]
        recipes_found = TypeAdapter(dict[str, dict[str, dict[str, Recipe]]]).validate_python(recipes)
    except UsageError as error:
        raise UsageError(f"cannot read the recipes {one_line(error)}") from error
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read the recipes {path}: {one_line(error)}") from error
    except (KeyError, TypeError) as error:
        raise UsageError(f"{path}: a file of recipes has the key recipes, as `stlbench tune` writes it") from error
    except ValidationError as error:
        raise UsageError(f"{path}: {first_problem(error, 'recipes')}") from error
    return Recipes(recipes_found, str(path))


def task_of(cell: CellId, recipe: Recipe | None = None) -> Task:
    """The task of a cell, as its track and recipe have it. Raises `UsageError` where it is not installed."""
    return on_track(load_task(cell.task), cell.agent, cell.track, recipe)


def on_track(task: Task, agent: Choice, track: Track, recipe: Recipe | None = None) -> Task:
    """The task as a track has it. On the track `plain` the agent has no recipe, and so trains with its defaults.

    Raises `UsageError` if the `hold` of a tuned recipe does not fit the task, or the task leaves out a part that it
    does not have on this track.
    """
    if track != "auto" and task.lacking:
        raise UsageError(f"{task.choice}: the task is without {task.lacking[0]} as it is")
    if track != "tuned":
        return for_every_method(task, agent.name, track)
    assert recipe is not None
    parameters: dict[str, Any] = {**task.recipe(agent.name), **recipe.agent}
    file = task.file.model_copy(update={"agents": {**task.file.agents, agent.name: parameters}})
    try:
        return replace(task, file=file if recipe.hold is None else file.held(recipe.hold))
    except ValueError as error:
        raise UsageError(f"the recipe for {task.name}: {error}") from error


def own_agent_on(task: Task, track: Track) -> str:
    """The agent that a task is trained with on a track unless another is named."""
    return agent_for(task.actions) if track == "auto" else task.own_agent


def write_recipes(path: Path, recipes: _Found, facts: Mapping[str, Any]) -> None:
    """Write a file that `read_recipes` reads, with facts of how they were found. Raises `UsageError`."""
    content = {
        **facts,
        "recipes": {
            task: {
                agent: {method: _written(recipe) for method, recipe in methods.items()}
                for agent, methods in agents.items()
            }
            for task, agents in recipes.items()
        },
    }
    written = yaml.safe_dump(content, sort_keys=False, width=100)
    text = f"# Recipes of the track tuned, written by `stlbench tune`.\n{written}"
    write(path, text)


def _written(recipe: Recipe) -> dict[str, Any]:
    agent = {"agent": dict(recipe.agent)} if recipe.agent else {}
    return agent if recipe.hold is None else {**agent, "hold": recipe.hold}
