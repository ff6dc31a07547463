"""The cells of a study, each with its identity and a key for the ledger: tasks x methods x agents x seeds, and those
that say what a reward asks for.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import product
from typing import Any

import numpy as np

from stlbench.contract import Agent, Intractable, System, Unsuitable
from stlbench.errors import UsageError, one_line
from stlbench.records.identity import CellId, Track
from stlbench.registry import named_tasks, plugins
from stlbench.registry.choices import Choice, parse_choice
from stlbench.simulation.environment import BatchEnvironment, model_of
from stlbench.study import initial
from stlbench.study.cell import (
    Cell,
    KeyPart,
    Recipes,
    agent_part,
    digest,
    harness,
    method_part,
    on_track,
    own_agent_on,
    parts_of,
    task_part,
)
from stlbench.study.code_changes import changed
from stlbench.study.initial import Initial
from stlbench.study.provenance import here
from stlbench.task import build_agent, build_method, fitting_methods
from stlbench.task.build import as_given
from stlbench.task.task import Task, load_task


def plan_cells(
    tasks: Iterable[Choice],
    methods: Iterable[Choice],
    agents: Iterable[Choice] | None,
    seeds: Sequence[int] | None,
    budget: str,
    track: Track | None = None,
    recipes: Recipes | None = None,
    init: Mapping[Choice, Initial] | None = None,
) -> tuple[Cell, ...]:
    """All cells of a study, the first seed of everything first.

    No method is imported, and an agent for the track `auto` alone, as its class has the recipe: so a study that is
    already done is answered at once; see `check_cells`. Without agents, each task is trained by its own
    (`Task.own_agent`); without a track, on its own (`Task.own_track`). Without seeds, the task's budget says how many.
    The agents of a method start from its policy in `init`, if there is one.
    Raises `UsageError` for an unknown name or budget, a task with errors, no seed, or a missing recipe.
    """
    if seeds is not None and (not seeds or min(seeds) < 0):
        raise UsageError(f"at least one seed is needed, none of them negative, got {list(seeds)}")
    if (track == "tuned") != (recipes is not None):
        raise UsageError("track tuned, and no other, needs a file of recipes, as `stlbench tune` writes it")
    keyed = {method: method_part(method) for method in methods}
    chosen = None if agents is None else tuple(agents)
    code, planned = harness(), list[_Planned]()
    for task in map(load_task, dict.fromkeys(tasks)):
        on = track or task.own_track
        trained_by = chosen or (Choice(own_agent_on(task, on)),)
        planned.append(
            _Planned(task, trained_by, seeds or range(task.budget(budget).seeds), budget, on, code, init or {})
        )
    every_seed = sorted(set().union(*(task.seeds for task in planned)))
    return tuple(
        task.cell(method, agent, seed, part, recipes)
        for seed, task, (method, part) in product(every_seed, planned, keyed.items())
        if seed in task.seeds
        for agent in task.agents
    )


@dataclass(frozen=True)
class _Planned:
    task: Task
    agents: Sequence[Choice]
    seeds: Sequence[int]
    budget: str
    track: Track
    harness: KeyPart
    begun: Mapping[Choice, Initial]
    tasks: dict[Any, Task] = field(default_factory=dict)
    known: dict[Any, tuple[KeyPart, KeyPart]] = field(default_factory=dict)
    """The parts of task and agent so far. A method changes them by its recipe and the form that it takes."""

    def cell(self, method: Choice, agent: Choice, seed: int, part: KeyPart, recipes: Recipes | None) -> Cell:
        place = None
        if (init := self.begun.get(method)) is not None:
            agent, place = init.given_to(agent), init.path
        recipe = recipes.of(self.task.choice, agent, method) if recipes else None
        setting = agent, None if recipe is None else (tuple(recipe.agent.items()), recipe.hold)
        if setting not in self.tasks:
            self.tasks[setting] = on_track(self.task, agent, self.track, recipe)
        helped = self.tasks[setting]
        form = setting, None if helped.otherwise is None else method  # only then the method decides
        if form not in self.known:
            task = as_given(helped, method)
            self.known[form] = task_part(task, self.budget), agent_part(task, agent)
        own, trained = self.known[form]
        used = self.harness, own, part, trained
        cell, parts = CellId(self.task.choice, method, agent, seed, self.budget, self.track), parts_of(used)
        home, deadline = named_tasks.place_of(self.task.choice.name), self.task.budget(self.budget).deadline
        key, code = digest([self.track, *parts, seed]), tuple(each.code for each in used)
        return Cell(cell, key, deadline, recipe, home, place, parts, code)


@dataclass(frozen=True)
class Checked:
    """The findings of a look at cells that are going to run."""

    notes: tuple[str, ...] = ()
    """A line for each agent that trains with its defaults."""
    agents: tuple[tuple[Choice, Agent], ...] = ()
    """Each agent, as it was built for each recipe."""


def check_cells(cells: Iterable[Cell]) -> Checked:
    """Load the methods and agents of these cells and check their parameters, before any of them runs.

    Raises `UsageError` with the first wrong parameter, plugin that cannot be loaded, or agent that cannot train here.
    """
    planned, notes, agents = tuple(cells), dict[str, None](), list[tuple[Choice, Agent]]()
    for method in dict.fromkeys(cell.id.method for cell in planned):
        plugins.check("methods", method)
    alike = {
        (cell.id.task, cell.id.agent, cell.id.track, str(cell.recipe), cell.init and cell.id.method): cell
        for cell in planned
    }
    for cell in alike.values():  # whatever its seed, and its method unless it starts from a policy
        task, agent = cell.load_task(), cell.id.agent
        with plugins.guarded(f"agent {agent}"):
            agents.append((agent, build_agent(task, agent)))
        if (stored := initial.arrays_of(cell)) is not None:
            with plugins.guarded(f"--init {cell.init} on task {task.name}"):
                initial.refuse_other(stored.policy, agents[-1][1], agent.name, task)
        if cell.id.track in ("shared", "tuned") and agent.name not in load_task(cell.id.task).file.agents:
            notes[f"task {cell.id.task} has no recipe for agent {agent}, which trains with its defaults"] = None
    return Checked(tuple(notes), tuple(agents))


def uncompiled(
    agents: Iterable[tuple[Choice, Agent]], cells: Iterable[Cell]
) -> Iterator[tuple[Choice, Callable[[], None]]]:
    """Those of the agents that train these cells and whose code this machine has not compiled; what compiles it.

    Otherwise each worker would compile it at the same time, in its first cell. An agent is asked when the one before
    it is compiled, as they may share code.
    """
    trained = {cell.id.agent for cell in cells}
    for choice, agent in agents:
        work = agent.uncompiled() if choice in trained else None
        if work is not None:
            if not callable(work):
                rule = "the contract says a function or None"
                raise UsageError(f"agent {choice}: uncompiled gives {type(work).__name__}, {rule}")
            yield choice, work


def examples(cells: Iterable[Cell]) -> tuple[Cell, ...]:
    """A few of the cells, with each task, method and agent at least once."""
    seen, chosen = set[tuple[str, Choice]](), list[Cell]()
    for cell in cells:
        parts = {("task", cell.id.task), ("method", cell.id.method), ("agent", cell.id.agent)}
        if parts - seen:
            seen |= parts
            chosen.append(cell)
    return tuple(chosen)


def preload(cells: Sequence[Cell]) -> None:
    """Load what these cells need, as far as it comes with stlbench; what cannot be loaded is passed over."""
    here()
    for cell in cells:
        with suppress(Exception):
            changed(cell)  # reads its files, so that its own look at them finds them read
        if plugins.find("tasks", cell.id.task.name).is_own:
            with suppress(Exception):
                _preload(cell.load_task(), cell)


def _preload(task: Task, cell: Cell) -> None:
    if plugins.find("methods", cell.id.method.name).is_own:
        with suppress(Exception):  # a method that does not fit
            environment = BatchEnvironment(task, build_method(task, cell.id.method), 2, 0)
            environment.reset()
            environment.step(np.tile(environment.actions.low, (2, 1)))
    if plugins.find("agents", cell.id.agent.name).is_own:
        build_agent(task, cell.id.agent).preload()


_RECIPE = "recipe"
_LEFT_OUT = ("cuts", "ends", "rewarded")
"""Parts of a task that change what a plan is for, each left out once where nothing else is said."""
_BUDGET = "quick"
"""A plan takes no environment steps; a cell has to have a budget."""


@dataclass(frozen=True)
class PlanSetting:
    """The plan's parts beside task and method."""

    without: str = ""
    """Parts of the task that are left out, joined by +."""
    parameters: tuple[tuple[str, str], ...] = ()
    """The agent's parameters, in place of those of the task's recipe."""

    @property
    def apart(self) -> bool:
        """Whether actions are not held: then another robustness is possible."""
        return "hold" in self.without.split("+")


def parse_settings(text: str) -> tuple[PlanSetting, ...]:
    """A comma list, "recipe,gamma=1,without=cuts+ends gamma=1"; a space joins what makes one setting."""
    return tuple(dict.fromkeys(_setting(item) for item in text.split(",")))


def _setting(item: str) -> PlanSetting:
    words = item.split()
    if words == [_RECIPE]:
        return PlanSetting()
    try:
        parameters = dict(parse_choice(f"{_RECIPE}[{','.join(words)}]").parameters)
    except UsageError:
        parameters = {}
    if not parameters:
        rule = "recipe, without=PART+PART or PARAMETER=VALUE of an agent that plans, or several joined by spaces"
        raise UsageError(f"settings: '{item.strip()}' is no setting; a setting is {rule}")
    return PlanSetting(parameters.pop("without", ""), tuple(parameters.items()))


def default_settings(task: Choice) -> tuple[PlanSetting, ...]:
    """The recipe; a discount of 1; and the task without its cuts, its ends, its rewarded form, each where it has them.

    Raises `UsageError` where there is no such task.
    """
    file, settings = load_task(task).file, [PlanSetting()]
    if all("gamma" in plugins.parameters(plugins.find("agents", name)) for name in _planners("reward")):
        settings.append(PlanSetting(parameters=(("gamma", "1"),)))
    return (*settings, *(PlanSetting(part) for part in _LEFT_OUT if file.has(part)))


def plan_alignment(
    task: Choice,
    methods: Sequence[Choice] | None = None,
    settings: Sequence[PlanSetting] | None = None,
    resolution: float | None = None,
) -> tuple[Cell, ...]:
    """The cells of a task: every method in every setting, after the formula itself.

    Without methods, all that fit; without settings, `default_settings`. Raises `UsageError` if the task is no system,
    has no such part, no method fits it, or no agent is installed that plans for a reward.
    """
    if task.parameters:
        raise UsageError(f"{task}: name the task alone, and give without=... as a setting")
    loaded = load_task(task)
    if not isinstance(loaded.dynamics, System):
        rule = "a plan sets the state of the simulator, which only the task of a System allows"
        raise UsageError(f"task {task}: nothing can be planned on it: {rule}")
    fitting = fitting_methods(loaded)
    chosen = tuple(map(Choice, fitting)) if methods is None else tuple(methods)
    # one that is not asked for its reward: that of the fewest inputs, which few other methods come before
    plainest = [Choice(name) for name in sorted(fitting, key=lambda name: (fitting[name].input_size, name))]
    if not chosen:
        raise UsageError(f"no installed method fits task {task}")
    fineness = {} if resolution is None else {"resolution": f"{resolution:g}"}
    settings = default_settings(task) if settings is None else tuple(settings)
    planners, formula = _planners("reward"), _planners("formula")
    if not planners:
        raise UsageError("no agent is installed that plans for a reward")
    budget = _BUDGET if _BUDGET in loaded.file.budgets else next(iter(loaded.file.budgets))
    cells = list[Cell]()
    for without in dict.fromkeys("hold" if setting.apart else "" for setting in settings):
        agents = [Choice(name, tuple(fineness.items())) for name in formula]
        if agents:
            cells += plan_cells([_without(task, without)], (plainest or chosen)[:1], agents, [0], budget)
    for setting in settings:
        parameters = tuple((fineness | dict(setting.parameters)).items())
        agents = [Choice(name, parameters) for name in planners]
        cells += plan_cells([_without(task, setting.without)], chosen, agents, [0], budget)
    _refuse_unplannable(cells)
    return tuple({cell.key: cell for cell in cells}.values())


def _refuse_unplannable(cells: Sequence[Cell]) -> None:
    """Raise `UsageError` if the agents refuse the model of every cell."""
    reason = ""
    for cell in cells:
        task = cell.load_task()
        try:
            agent = build_agent(task, cell.id.agent)
            return agent.check(model_of(task, build_method(task, cell.id.method)))
        except (Intractable, Unsuitable) as error:
            reason = reason or one_line(error)
        except UsageError:
            raise
        except Exception:  # a plugin's own, which the run records for its cell
            return
    if cells:
        raise UsageError(f"task {cells[0].id.task.name}: nothing can be planned on it: {reason}")


def _planners(maximise: str) -> list[str]:
    kinds, _ = plugins.loadable("agents")
    return [name for name, kind in kinds.items() if getattr(kind, "plans", None) == maximise]


def _without(task: Choice, parts: str) -> Choice:
    return Choice(task.name, (("without", parts),) if parts else ())
