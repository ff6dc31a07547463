"""The track `auto`: all that helps a training, by rules from the formula, the ranges and the time, for every task.

A task is then dynamics with signals and their ranges, a sampling time, a time for which an action is held, starts and a
formula. No rule knows the method.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from math import ceil
from typing import Any, cast

import numpy as np

from stlbench import stl
from stlbench.contract import ActionBox, Agent, Array, System
from stlbench.errors import UsageError, cause, one_line
from stlbench.records.identity import Track
from stlbench.registry import plugins
from stlbench.schedules.plan import UnscheduledError, conjunction
from stlbench.schedules.regions import Regions
from stlbench.schedules.schedule import Schedule, held, is_schedule, pursued, schedules
from stlbench.simulation import faults
from stlbench.simulation.environment import fulfilling
from stlbench.simulation.worlds import make_world
from stlbench.stl import Formula, fragment
from stlbench.task.derived import can_fall, derived
from stlbench.task.entry import Region
from stlbench.task.file import LOST, Budget, Ending, Exploring, TaskFile, TrainingEpisodes
from stlbench.task.forms import Window, normal_form, recurring, windows
from stlbench.task.starts import sample
from stlbench.task.task import Task

_FEW = 8
"""Copies of an environment whose first samples are looked at. A system has eight times as many, as copies are cheap."""


def alternatives(task: Task) -> tuple[Schedule, ...]:
    """The schedules of a task's formula, the best first; there are none if the formula is a schedule already.

    Raises `UnscheduledError` if no schedule is found. It names the operator or the step, and the reason.
    """
    file = task.file
    return _alternatives(file.formula, regions(task), file.hold, file.steps)


def regions(task: Task) -> Regions:
    """Distances between conditions on a task, and from its starts."""
    return _regions_of(task.file, initial_samples(task))


@lru_cache(maxsize=256)
def _alternatives(formula: Formula, regions: Regions, hold: int, steps: int) -> tuple[Schedule, ...]:
    """Kept, since a run asks for each task once for each of its methods and seeds."""
    if is_schedule(normal_form(formula), regions):
        return ()
    return tuple(schedules(formula, regions, hold, steps))


def _regions_of(file: TaskFile, initial: Array) -> Regions:
    """The regions of a task, always the same object for the same ranges and starts."""
    rows = np.asarray(initial, dtype=np.float64).tolist()
    return _regions(tuple(file.box.items()), tuple(units(file).items()), tuple(map(tuple, rows)))


@lru_cache(maxsize=256)
def _regions(
    box: tuple[tuple[str, tuple[float, float]], ...],
    unit: tuple[tuple[str, str], ...],
    initial: tuple[tuple[float, ...], ...],
) -> Regions:
    """Kept, since its points and distances are found once."""
    return Regions(dict(box), dict(unit), np.array(initial))


def scheduled(task: Task) -> Formula | None:
    """The formula of the schedule; None where there is none, or none is needed."""
    if task.file.schedule is not None:
        return task.file.schedule
    try:
        found = alternatives(task)
    except UnscheduledError:
        return None
    return found[0].formula if found else None


def rewarded(file: TaskFile, initial: Array) -> Formula:
    """The formula that methods are given.

    Args:
        file: the file of a task, with its schedule if it has one.
        initial: samples (n, k) of the signals at the start of episodes.
    """
    formula = file.formula
    if file.schedule is not None:
        formula = conjunction(pursued(fragment(file.schedule), _regions_of(file, initial)))
    for rule in (normal_form, lambda now: derived(now, file.box, units(file), initial, file.hold)):
        formula = formula if (other := rule(formula)) == formula else other  # an equal one may be written otherwise
    return formula


def units(file: TaskFile) -> dict[str, str]:
    """Signal -> its unit."""
    return {name: signal.unit for name, signal in file.signals.items()}


def initial_samples(task: Task) -> Array:
    """Signals (n, k) at the start of some episodes, always the same ones."""
    count = 8 * _FEW if isinstance(task.dynamics, System) else _FEW
    try:
        world = make_world(task, count)
        world.restart(np.arange(count), task.starts.of_training(np.random.default_rng(0), count))
        faults.check_signals(task, world.signals, count)
    except faults.PluginFault as error:
        raise UsageError(f"{error}; `stlbench check {task.name}` says which rule it breaks") from error
    except UsageError:
        raise
    except Exception as error:
        if plugins.blamed(error) is not None:  # it is told with the plugin's name
            raise
        raise UsageError(f"task {task.name}: {cause(error)}") from error
    return world.signals


_REACH = 20
"""Fewest steps that a discount reaches over. A pole on a cart was learned in 15 of 24 runs with 10, in 20 with 20."""
_MOST = 0.98
"""The greatest discount for continuous actions. It was chosen for MountainCar, whose goal comes late after a swing: no
seed learned it with 0.95."""

PATIENCE = 3
"""A training may end after this many checkpoints without a better one, at one that satisfies; a budget may say
another number."""
EPISODES = 900
"""The fewest episodes of the budget `quick`. Reported seeds led to it: with fewer, `ball-in-cup` failed."""
EXPLORED = 0.25
"""Share of the decisions in training that belong to episodes which begin at a random time."""
LENGTH = 40
"""Decisions after which such an episode is broken off, on average; at most half of the task's."""
_FEWEST = 16
"""Episodes begin where a goal holds if so many of the states drawn fulfil it. Fewer would be the same starts again."""


def for_every_method(task: Task, agent: str, track: Track) -> Task:
    """The task that a track's methods all train on: with the rules' help (`auto`), with none (`plain`), or as it is."""
    if track == "auto":
        return automatic(task, agent)
    if track == "plain":  # the agent has no recipe there, and so trains with its defaults
        file = task.file.plain()
        return replace(task, file=file.model_copy(update={"agents": {**file.agents, agent: {}}}))
    return task


def automatic(task: Task, agent: str) -> Task:
    """The task with the rules' help for training with an agent, and with no help by hand.

    The parts that the task leaves out are left out. Raises `UsageError` if no rule derives such a part.
    """
    schedule = scheduled(task)
    if "schedule" in task.left_out:
        if schedule is None:
            raise UsageError(f"{task.choice}: the task is without schedule as it is on the track auto")
        schedule = None
    helped = _helped(replace(task, file=task.file.model_copy(update={"schedule": schedule})), agent)
    for part in task.left_out:
        if part not in ("hold", "schedule"):  # the first is the task's own, the second is left out already
            try:
                helped = helped.without(part)
            except ValueError as error:
                raise UsageError(f"{task.choice}: {error} on the track auto") from error
    if "rewarded" in task.left_out:
        helped = helped.model_copy(update={"nested": None if schedule is not None else task.file.nested})
    return replace(task, file=helped, otherwise=_otherwise(task) if helped.schedule is None else None)


def _otherwise(task: Task) -> Formula | None:
    """The form for methods that do not take F inside G, if no schedule serves it by visits: p all the time.

    That may be impossible: two forces cannot keep a cart slow. So a method that takes the formula itself gets it.
    """
    if (formula := held(task.formula)) == task.formula or "schedule" in task.left_out:
        return None
    stronger = replace(task, file=task.file.model_copy(update={"formula": formula, "nested": None}))
    file = stronger.file.model_copy(update={"schedule": scheduled(stronger)})
    return file.followed if "rewarded" in task.left_out else rewarded(file, initial_samples(task))


def _helped(task: Task, agent: str) -> TaskFile:
    """The task's file with all help."""
    file = task.file
    bare = replace(task, file=file.model_copy(update={"training": TrainingEpisodes()}))
    initial = initial_samples(bare)
    nested = None
    if file.nested is not None and file.schedule is None:
        nested = rewarded(file.model_copy(update={"formula": file.nested}), initial)
    return file.model_copy(
        update={
            "features": "formula",
            "rewarded": rewarded(file, initial),
            "nested": nested,
            "training": TrainingEpisodes(
                cuts=cuts(file.followed, file.hold, file.steps), ends=_ends(bare), exploring=_exploring(bare)
            ),
            "budgets": {name: _budget(name, budget, file.steps) for name, budget in file.budgets.items()},
            "agents": {agent: recipe(agent, task)},
        }
    )


def _budget(name: str, budget: Budget, steps: int) -> Budget:
    """The budget with patience; `quick` has 900 episodes of so many steps at least."""
    times = max(1.0, EPISODES * steps / budget.steps) if name == "quick" else 1.0
    longer = {"steps": round(times * budget.steps), "checkpoints": ceil(times * budget.checkpoints)}
    return budget.model_copy(update={**longer, "patience": PATIENCE if budget.patience is None else budget.patience})


def recipe(agent: str, task: Task) -> dict[str, Any]:
    """The agent's parameters: those of its class's `recipe`, of which rules change `gamma`, and the task's own grid.

    The discount is at least 1 - hold / 20, and so reaches over 20 steps. The formula G F p asks for a reach over the
    longest window of F: at least 1 - 1 / (2.5 W) for W decisions. Continuous actions ask for a quarter of the episode's
    D decisions: at least 1 - 4 / D, but no more than 0.98.
    """
    parameters = _declared(agent)
    if (grid := task.recipe(agent).get("grid")) is not None:
        parameters["grid"] = grid
    if isinstance(parameters.get("gamma"), int | float):
        again = max((node.b for node in recurring(task.file.followed)), default=0) / task.file.hold
        reaches = [parameters["gamma"], 1 - task.file.hold / _REACH, 1 - 1 / max(1.0, 2.5 * again)]
        if isinstance(task.actions, ActionBox):
            reaches.append(min(_MOST, 1 - 4 * task.file.hold / task.file.steps))
        parameters["gamma"] = round(max(reaches), 4)
    return parameters


def _declared(agent: str) -> dict[str, Any]:
    """The recipe of an agent's class; none where it is not installed, as for results of another machine."""
    if (plugin := plugins.known("agents", agent)) is None:
        return {}
    declared = cast(type[Agent], plugin.load()).recipe
    try:
        json.dumps(parameters := dict(declared))
    except (TypeError, ValueError) as error:
        raise plugin.error(f"its recipe should have parameters and values that JSON has: {one_line(error)}") from error
    return parameters


def cuts(formula: Formula, hold: int, steps: int) -> tuple[int, ...]:
    """The steps at which the next goal changes: the ends of the goals' windows but the last, up to whole decisions.

    There is no cut if the next goal has to hold at once, as in a tube: a robot has to be there in time.
    """
    goals = [window for window in windows(formula) if not window.invariant]
    at_once = {window.begin for window in goals if window.throughout}
    ends = sorted({window.end for window in goals})
    held = {-(-end // hold) * hold for end in ends[:-1] if not at_once & {end, end + 1}}
    return tuple(sorted(cut for cut in held if 0 < cut < steps))


def _ends(task: Task) -> tuple[Ending, ...]:
    """The conditions that end training episodes early, which pays the floor.

    A robot that can fall ends an episode when a signal leaves its range, if a long invariant reads that signal. A long
    invariant lasts for half of the task or more. Another robot, as one that leaves a room, comes back: a punishment
    would keep it from goals near the walls.

    An environment that ends episodes itself pays the floor if the formula is lost with the last sample held. Otherwise
    a pole that falls towards its goal is paid for its place to the end.
    """
    file = task.file
    if not isinstance(task.dynamics, System):
        return (Ending.model_validate({"where": LOST}),) if file.terminated == "hold" else ()
    if not can_fall(file.followed, file.box):
        return ()
    long = [window for window in windows(file.followed) if window.invariant and 2 * window.end >= file.steps]
    names = [name for name in task.signals if any(name in stl.signals(window.psi) for window in long)]
    ends = [f"{name} < {file.box[name][0]!r} | {name} > {file.box[name][1]!r}" for name in names]
    return (Ending.model_validate({"where": " | ".join(ends)}),) if ends else ()


def _lasting(parts: Sequence[Window], file: TaskFile) -> list[Window]:
    """The invariants; a schedule has only those as long as its goals, as a shorter one may exclude a later goal."""
    last = max((part.end for part in parts if not part.invariant), default=0)
    return [part for part in parts if part.invariant and (file.schedule is None or part.end >= last)]


def _exploring(task: Task) -> Exploring | None:
    """Episodes that begin at a random time, in states met before or in states drawn from the ranges.

    The invariants hold in the states drawn, and a goal holds in half of them. Goals of the first sample alone do not
    count, as no action changes it. The states are initial ones if no coordinate has a range. An environment whose state
    cannot be set has no such episodes.
    """
    if not isinstance(task.dynamics, System):
        return None
    assert task.file.initial is not None
    decisions = task.file.decisions
    length = max(1, min(LENGTH, decisions // 2))
    # The share of episodes is greater than that of decisions, as these have `length` decisions and others have all.
    share = EXPLORED * decisions / (EXPLORED * decisions + (1 - EXPLORED) * length)
    box = dict[str, tuple[float, float]]()
    for name, (low, high) in task.file.initial.box.items():
        least, greatest = task.file.box.get(name, (low, high))
        box[name] = min(low, least), max(high, greatest)
    parts = windows(task.file.followed)
    # A state drawn has values of its coordinates only, so a condition on another signal cannot be asked of it.
    held = [part.psi for part in _lasting(parts, task.file) if {*stl.signals(part.psi)} <= {*box}]
    if not {*box} & {*task.file.box} and task.file.initial.where is not None:
        held.append(task.file.initial.where)
    where = " & ".join(f"({condition})" for condition in held) or None
    states = Region.model_validate({"box": box, "where": where})
    try:
        sample(states, np.random.default_rng(0), 256)
    except UsageError:  # the invariants hold almost nowhere within the ranges
        return Exploring(share=share, kept=1.0, length=length)
    goals = [part for part in parts if not part.invariant]
    found = zip(goals, fulfilling(task, states, [goal.psi for goal in goals]), strict=True)
    apt = (goal for goal, reached in found if goal.end and len(reached) >= _FEWEST)
    near = [{"until": goal.end, "where": str(goal.psi)} for goal in apt]
    return Exploring.model_validate({"share": share, "kept": 0.5, "length": length, "states": states, "near": near})
