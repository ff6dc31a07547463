"""The cells that say what a reward asks for: plans for it in several settings, and for the formula itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from stlbench.contract import Intractable, System, Unsuitable
from stlbench.errors import UsageError, one_line
from stlbench.registry import plugins
from stlbench.registry.choices import Choice, parse_choice
from stlbench.rollout.model import model_of
from stlbench.study.cell import Cell
from stlbench.study.plan import plan_cells
from stlbench.task import build_agent, build_method, fitting_methods, load_task
from stlbench.task.task import Task

_RECIPE = "recipe"
_LEFT_OUT = ("cuts", "ends", "rewarded")
"""Parts of a task that change what a plan is for, each left out once where nothing else is said."""
_BUDGET = "quick"
"""A plan takes no environment steps; a cell has to have a budget."""


@dataclass(frozen=True)
class PlanSetting:
    """What is planned for beside task and method."""

    without: str = ""
    """Parts of the task that are left out, joined by +."""
    parameters: tuple[tuple[str, str], ...] = ()
    """Of the agent, in place of those of the task's recipe."""

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
    budget = _budget(loaded)
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


def _budget(task: Task) -> str:
    return _BUDGET if _BUDGET in task.file.budgets else next(iter(task.file.budgets))
