"""Tuning: the same number of trials for each method, scored on the starts for selection and on seeds of their own.

A trial is a value for each parameter that the agent says may be tuned (`Agent.search_space`), and its cells are cells
like any other. So a tuning that is interrupted goes on: what is in the ledger is not trained again, and the same
results lead the search to the same next trial.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple, cast

from stlbench.contract import Agent
from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.records.result import Result
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.study.cell import Cell, Recipe
from stlbench.study.plan import plan_cells
from stlbench.study.study import Study
from stlbench.task import load_task
from stlbench.task.task import Task

if TYPE_CHECKING:
    import optuna

FIRST_SEED = 100  # of tuning. Those below are reported.
HOLD = "hold"
"""In a search space, the steps for which the task holds an action; everything else is a parameter of the agent."""
_AT_ONCE = 2
"""Trials of one entrant that are chosen before the results of either are known, so that two cores have work."""
_AT_RANDOM = 6  # trials before the search begins to choose by what came of them
Option = float | int | str | bool
Values = Mapping[str, Option]


class Trial(NamedTuple):
    values: Values
    status: str  # `done` where all of its seeds are, else how the first ended that is not
    satisfaction: float | None = None  # share of the starts for selection that satisfy, mean over the seeds, in [0, 1]
    robustness: float | None = None  # from these starts, mean over the seeds

    @property
    def rank(self) -> tuple[float, float]:
        """The better, the greater: first by satisfaction, then by robustness, as checkpoints are chosen."""
        if self.satisfaction is None or self.robustness is None:
            return -math.inf, -math.inf
        return self.satisfaction, self.robustness


@dataclass
class Entrant:
    """One method on one task with one agent: its search space, and its trials so far."""

    task: Choice
    agent: Choice
    method: Choice
    space: Mapping[str, tuple[Option, ...]]
    shared: Values  # the values of the recipe that all methods share: the first trial
    trials: list[Trial] = field(default_factory=list)

    @property
    def best(self) -> Trial | None:
        done = [trial for trial in self.trials if trial.status == "done"]
        return max(done, key=lambda trial: trial.rank, default=None)

    @property
    def hopeless(self) -> bool:
        """The method does not fit the task, whatever the recipe is."""
        return bool(self.trials) and self.trials[0].status in ("intractable", "unsuitable")

    def recipe(self) -> Recipe:
        """The values of the best trial that differ from the shared recipe; empty if no trial was finished."""
        changed = self._changed(self.best.values) if self.best else {}
        hold = changed.pop(HOLD, None)
        return Recipe(changed, None if hold is None else int(hold))

    def cells(self, values: Values, study: Study) -> tuple[Cell, ...]:
        changed = {name: str(value) for name, value in self._changed(values).items()}
        hold = [(HOLD, changed.pop(HOLD))] if HOLD in changed else []
        task = Choice(self.task.name, (*self.task.parameters, *hold))
        agent = Choice(self.agent.name, (*self.agent.parameters, *changed.items()))
        return plan_cells([task], [self.method], [agent], study.seeds, study.budget)

    def _changed(self, values: Values) -> dict[str, Option]:
        return {name: value for name, value in values.items() if value != self.shared[name]}


def entrants(study: Study) -> tuple[Entrant, ...]:
    """The subjects of tuning: each task, method and agent of a study, with the same space for all methods.

    Raises `UsageError` for a seed that is reported, another track than `shared`, a held task, or an agent without a
    space.
    """
    if study.seeds is None or min(study.seeds) < FIRST_SEED:
        raise UsageError(f"seeds below {FIRST_SEED} are for reports, not for tuning; say --seeds 100-101")
    if study.track not in (None, "shared"):
        raise UsageError("tuning begins with the shared recipe; give a track to `stlbench run` instead")
    return tuple(
        entrant
        for task in map(load_task, study.tasks)
        for agent in study.agents or (Choice(task.own_agent),)
        for entrant in _of_agent(task, agent, study.methods)
    )


def _of_agent(task: Task, agent: Choice, methods: Sequence[Choice]) -> Iterator[Entrant]:
    if HOLD in dict(task.choice.parameters):
        raise UsageError(f"{task.name}: {HOLD} is tuned; name the task without it")
    kind = cast(type[Agent], plugins.find("agents", agent.name).load())
    fixed = dict(agent.parameters)
    declared = {name: values for name, values in kind.search_space.items() if name not in fixed}
    if not declared:
        raise UsageError(f"agent {agent} has nothing to tune: it declares no search_space")
    shared = {name: _shared(task, agent, name) for name in declared}
    space = {name: _candidates(task, name, values, shared[name]) for name, values in declared.items()}
    for method in methods:
        yield Entrant(task.choice, agent, method, space, shared)


def _shared(task: Task, agent: Choice, name: str) -> Option:
    if name == HOLD:
        return task.file.hold
    known = plugins.parameters(plugins.find("agents", agent.name))
    if name not in known:
        raise UsageError(f"agent {agent.name}: its search_space has '{name}', which is no parameter of it")
    value: Option = task.recipe(agent.name).get(name, known[name].default)
    return value


def _candidates(task: Task, name: str, values: tuple[Option, ...], own: Option) -> tuple[Option, ...]:
    fitting = [value for value in values if name != HOLD or _holds(task, int(value))]
    return tuple(fitting) if own in fitting else tuple(sorted([*fitting, own], key=_place))


def _place(value: Option) -> tuple[float, str]:
    """By which the values of a parameter are ordered; it may have texts too."""
    return (0.0, value) if isinstance(value, str) else (float(value), "")


def _holds(task: Task, steps: int) -> bool:
    try:
        task.file.held(steps)
    except ValueError:
        return False
    return True


def search(
    tuned: Sequence[Entrant],
    study: Study,
    trials: int,
    run: Callable[[Sequence[Cell]], Mapping[CellId, Result]],
) -> None:
    """Give each entrant so many trials, and append them to it. `run` runs missing cells, and returns all results.

    A method that does not fit its task has no more than the first trials. Raises `UsageError` without Optuna.
    """
    searches = [_Search(entrant) for entrant in tuned]
    for begin in range(0, trials, _AT_ONCE):
        going = [one for one in searches if not one.entrant.hopeless]
        trials_of = [(one, one.ask(study)) for one in going for _ in range(min(_AT_ONCE, trials - begin))]
        results = run(tuple({cell.id: cell for _, (_, cells) in trials_of for cell in cells}.values()))
        for one, (trial, cells) in trials_of:
            one.tell(trial, [results[cell.id] for cell in cells])


class _Search:
    """Chooses the trials of one entrant: the shared recipe, some at random, then by tree-structured Parzen estimators
    (Bergstra et al. 2011), as Optuna has them. Random choices are the same for every method."""

    def __init__(self, entrant: Entrant) -> None:
        self.entrant = entrant
        optuna = _optuna()
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        sampler = optuna.samplers.TPESampler(seed=FIRST_SEED, n_startup_trials=_AT_RANDOM)
        self.study = optuna.create_study(direction="maximize", sampler=sampler)
        self.study.enqueue_trial(dict(entrant.shared))

    def ask(self, study: Study) -> tuple[optuna.trial.Trial, tuple[Cell, ...]]:
        trial = self.study.ask()
        values = {name: trial.suggest_categorical(name, among) for name, among in self.entrant.space.items()}
        return trial, self.entrant.cells(cast(Values, values), study)

    def tell(self, trial: optuna.trial.Trial, results: Sequence[Result]) -> None:
        ended = _ended(cast(Values, trial.params), results)
        self.entrant.trials.append(ended)
        if ended.satisfaction is None or ended.robustness is None:
            self.study.tell(trial, state=_optuna().trial.TrialState.FAIL)
            return
        # robustness decides between trials of equal satisfaction, and is squashed so that it decides nothing else
        finest = 1e-4
        self.study.tell(trial, ended.satisfaction + finest * (0.5 + math.atan(ended.robustness) / math.pi))


def _ended(values: Values, results: Sequence[Result]) -> Trial:
    status = next((result.status for result in results if result.status != "done"), "done")
    points = [result.measurement.selection for result in results if result.measurement]
    if status != "done":
        return Trial(values, status)
    satisfaction = math.fsum(point.satisfaction for point in points) / len(points)
    robustness = math.fsum(point.robustness_mean for point in points) / len(points)
    return Trial(values, status, satisfaction, robustness)


def _optuna() -> Any:
    try:
        import optuna
    except ImportError as error:
        raise UsageError('tuning needs Optuna: pip install "stlbench-rl[tune]"') from error
    return optuna
