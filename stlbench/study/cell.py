"""A cell as it is planned: what is run, by the rules of which track (`result.Track`), and the code that its key
stands for.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from pydantic import ConfigDict, TypeAdapter, ValidationError

from stlbench.contract import GymTask, System
from stlbench.errors import UsageError, one_line
from stlbench.records.identity import CellId, Track, first_problem
from stlbench.records.result import Measurement, Result, Status
from stlbench.records.result_files import write
from stlbench.registry import named_tasks, plugins
from stlbench.registry.choices import Choice
from stlbench.registry.fingerprint import Code, code_of, own_code
from stlbench.stl.language.structure import walk
from stlbench.stl.language.syntax import Between
from stlbench.task.entry import Count
from stlbench.task.file import Environment
from stlbench.task.reading import dump_yaml, load_yaml
from stlbench.task.task import Task, agent_for, load_task
from stlbench.tracks.auto import for_every_method


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
        found = TypeAdapter(_Found).validate_python(recipes)
    except UsageError as error:
        raise UsageError(f"cannot read the recipes {one_line(error)}") from error
    except (OSError, UnicodeError) as error:
        raise UsageError(f"cannot read the recipes {path}: {one_line(error)}") from error
    except (KeyError, TypeError) as error:
        raise UsageError(f"{path}: a file of recipes has the key recipes, as `stlbench tune` writes it") from error
    except ValidationError as error:
        raise UsageError(f"{path}: {first_problem(error, 'recipes')}") from error
    return Recipes(found, str(path))


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
    content = {**facts, "recipes": TypeAdapter(_Found).dump_python(recipes, exclude_defaults=True)}
    written = dump_yaml(content, width=100)
    write(path, f"# Recipes of the track tuned, written by `stlbench tune`.\n{written}")


@dataclass(frozen=True)
class Cell:
    """One training run and its evaluation."""

    id: CellId
    key: str  # hash (32 hex digits) of all that can change the result, and of nothing else
    deadline: float  # wall seconds after which it is stopped
    recipe: Recipe | None = None  # of its method, on the track `tuned`
    folder: Path | None = None  # where its task is, for a task that is a folder
    init: Path | None = None  # the policy whose hash the agent's choice has, from which it starts
    parts: tuple[tuple[str, str], ...] = field(default=(), repr=False)
    """Name and hash of each part of the key but the track and the seed, as `PARTS` names them."""
    code: tuple[Code, ...] = field(default=(), repr=False)
    """The code of the harness, the task, the method and the agent, as it was when the key was made."""

    def load_task(self) -> Task:
        """The task as the cell's track and recipe have it. Raises `UsageError` where it is not installed."""
        if self.folder is not None:
            named_tasks.know(self.folder)  # this process may be another than the one in which the user named the folder
        return on_track(load_task(self.id.task), self.id.agent, self.id.track, self.recipe)

    def ended(
        self, status: Status, reason: str = "", details: str = "", measurement: Measurement | None = None
    ) -> Result:
        return Result(self.id, self.key, status, reason, details, measurement)


def digest(parts: Iterable[object]) -> str:
    """A hash (32 hex digits) of values that JSON has."""
    # Keys are not sorted: the order of signals, of states and of action axes has a meaning.
    return hashlib.sha256(json.dumps(list(parts)).encode()).hexdigest()[:32]


def derive_seed(*parts: str | int) -> int:
    """A seed in 0..2^63-1 from what it is for: derive_seed("starts", "hold-disc", 3).

    Leave the method out of the parts, and every method gets the same random numbers: comparisons are paired.
    """
    return int.from_bytes(hashlib.sha256(json.dumps(parts).encode()).digest()[:8], "big") >> 1


HARNESS = 1
"""Which state of stlbench's own code a result is of. Raise it where `tests/study/test_pinned_bits.py` says so."""
PARTS = ("harness", "task", "method", "agent", "packages")
"""Their names: stlbench's own code, the task, the method, the agent with its recipe, and the versions of the installed
distributions that the plugins import."""
_WORDS = ("title", "source", "notes", "plane", "best_known", "baselines")
_NO_PART: dict[str, Any] = dict.fromkeys((*_WORDS, "agents", "budgets", "schedules"), True) | {"environment": {"drawn"}}
"""The entries of a task file for people, tables and pictures alone, or that are in a cell's key by themselves."""
_NO_SYSTEM: dict[str, Any] = {"environment": True, "terminated": True, "signals": {"__all__": {"expression"}}}
"""Its entries for environments alone."""
_OF_BUDGET = {"steps", "checkpoints", "patience", "seconds", "random_starts"}  # what of a budget changes a result
_RANGES = 1
"""The state of the ranges of until, release and since, of which the scores of early ends are made."""
_NO_CODE = Code()


@dataclass(frozen=True)
class KeyPart:
    """The addition of one plugin, as it was chosen, to a key."""

    digest: str
    code: Code


def parts_of(used: Sequence[KeyPart]) -> tuple[tuple[str, str], ...]:
    """Name and hash of each part of a key but track and seed, of harness, task, method and agent."""
    packages = sorted({package for part in used[1:] for package in part.code.packages})
    return tuple(zip(PARTS, (*(part.digest for part in used), digest(packages)), strict=True))


def harness() -> KeyPart:
    """stlbench's own code that trains and scores a cell: its revision, and the files that must not change meanwhile."""
    return KeyPart(digest(["harness", HARNESS]), code_of("stlbench.study.trial", packages=False))


def task_part(task: Task, budget: str) -> KeyPart:
    """Words and pictures for people change no result, nor do other budgets, deadlines, recipes of other agents.

    The versions of the software of an environment belong to it, and the source of those of its modules that are
    the user's own.
    """
    left_out = _NO_PART | _NO_SYSTEM if isinstance(task.dynamics, System) else _NO_PART
    content = task.file.model_dump(mode="json", exclude=left_out)
    numbers = task.budget(budget).model_dump(mode="json", include=_OF_BUDGET, exclude_none=True)
    values: list[Any] = [task.choice.name, content, numbers, *_beyond_json(task.file.environment)]
    if task.view is not None:
        values.append(task.view.revision)
    if task.otherwise is not None:
        values.append(str(task.otherwise))
    if task.file.terminated != "hold" and _has_until(task):
        values.append(_RANGES)
    if not isinstance(task.dynamics, GymTask):
        return _part("tasks", task.choice.name, values)
    return _part("tasks", task.choice.name, [*values, task.source.software], own_code(_modules(task)))


def _beyond_json(entry: Environment | None) -> list[str]:
    """The arguments of an environment as Python writes them, if JSON changes them, as dates and numbers as keys."""
    if entry is None or entry.model_dump(mode="json", include={"kwargs"})["kwargs"] == entry.kwargs:
        return []
    return [repr(entry.kwargs)]


def _has_until(task: Task) -> bool:
    """Whether a formula that the referee scores has an until, a release or a since."""
    others = [protocol.formula for protocol in task.file.protocols.values() if protocol.formula is not None]
    return any(isinstance(part, Between) for formula in (task.formula, *others) for part in walk(formula))


def _modules(task: Task) -> tuple[str, ...]:
    """The modules that define a task's environment, and the one that its id names."""
    entry = task.file.environment
    if entry is None or entry.id is None:
        return task.source.modules
    named = entry.id if entry.api == "pettingzoo" else entry.id.rpartition(":")[0]
    return (*task.source.modules, *([named] if named else []))


def method_part(choice: Choice) -> KeyPart:
    return _part("methods", choice.name, [str(choice)])


def agent_part(task: Task, choice: Choice) -> KeyPart:
    """An agent with the parameters that the user set, and the task's recipe for it."""
    return _part("agents", choice.name, [str(choice), dict(task.recipe(choice.name))])


def _part(kind: str, name: str, values: list[Any], further: Code = _NO_CODE) -> KeyPart:
    """A plugin, and further code that it works on.

    A plugin of this distribution counts by its revision, so its code can move. Of any other, the files count, and the
    version of its distribution, which may have parts that no file shows.
    """
    plugin = plugins.find(kind, name)
    code = code_of(plugin.entry_point.module) | further
    source = [plugin.revision] if plugin.is_own else [plugin.version, code.digest]
    return KeyPart(digest([*values, plugin.distribution, *source]), code)
