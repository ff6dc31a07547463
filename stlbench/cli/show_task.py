"""`stlbench show task`: what a task asks, what its controller and baselines get, what methods make of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from stlbench.cli.common import Json, print_json, warn
from stlbench.cli.completion import names
from stlbench.cli.fit import fit
from stlbench.cli.show_task_text import print_task
from stlbench.errors import cause, one_line

if TYPE_CHECKING:
    from stlbench.records.result import Score
    from stlbench.rollout.questions import Question
    from stlbench.task.task import Task

_T = TypeVar("_T")


def task(
    name: Annotated[
        str,
        typer.Argument(metavar="NAME", help="A name, or the path of a task's folder.", autocompletion=names("tasks")),
    ],
    as_json: Json = False,
) -> None:
    """Show a task: formula, signals, actions, training, budgets, controller and baselines, what methods make of it.

    \b
    Examples:
      stlbench show task hold-disc
      stlbench show task robot-nav --json
      stlbench show task ./my-task
    """
    from stlbench.registry import plugins
    from stlbench.task import load_task

    loaded = load_task(name)
    plugin = plugins.find("tasks", loaded.choice.name)
    content = {"name": loaded.name, "distribution": plugin.distribution, "version": plugin.version} | facts(loaded)
    if as_json:
        print_json(content)
    else:
        print_task(content)


def facts(task: Task) -> dict[str, Any]:
    """All that is shown, as plain values. Intervals of formulas are in steps."""
    from stlbench import stl
    from stlbench.registry import plugins
    from stlbench.rollout.standards import by_hand, differences
    from stlbench.study.plugin_guard import ask

    file = task.file
    return {
        "title": file.title,
        "source": file.source,
        "notes": " ".join(file.notes.split()),
        "formula": str(task.formula),
        "horizon": stl.horizon(task.formula),
        "steps": file.steps,
        "sampling_time": file.sampling_time,
        "hold": file.hold,
        "starts": file.starts,
        "features": _features(task),
        "environment": None if file.environment is None else file.environment.id,
        "beyond_state": _beyond_state(task),
        "controller": _scored(_answer(by_hand(task.choice))),
        "baselines": _baselines(task),
        "best_known": None if file.best_known is None else file.best_known.model_dump(),
        "signals": {name: signal.model_dump(exclude_none=True) for name, signal in file.signals.items()},
        "terms": _terms(task),
        "actions": _actions(task),
        "robots": file.robots,
        "training": file.training.model_dump(exclude_none=True),
        "budgets": {name: budget.model_dump() for name, budget in file.budgets.items()},
        "protocols": {
            key: {
                "title": protocol.title,
                "formula": str(protocol.formula or file.formula),
                "starts": protocol.starts,
            }
            for key, protocol in file.protocols.items()
        },
        "own_agent": task.own_agent,
        "agents": file.agents,
        "methods": _methods(task),
        "equal_rewards": [
            dict(vars(difference)) for difference in differences(task.choice, plugins.available("methods"), ask)
        ],
    }


def _features(task: Task) -> str:
    """What policies see: "engineered" features or "state" of a system, the "observation" of anything else."""
    from stlbench.contract import System

    return task.file.features if isinstance(task.dynamics, System) else "observation"


def _beyond_state(task: Task) -> tuple[str, ...]:
    """What policies see beyond the state; nothing where they see an observation, or the state alone."""
    from stlbench.contract import System

    dynamics, engineered = task.dynamics, task.file.features == "engineered"
    return dynamics.beyond_state if isinstance(dynamics, System) and engineered else ()


def _actions(task: Task) -> dict[str, dict[str, Any]]:
    """Name -> ends, count and unit; those of the environment where the file has none."""
    declared = {name: axis.model_dump(exclude_none=True) for name, axis in task.file.actions.items()}
    return declared or {axis.name: axis.ends for axis in task.source.axes}


def _answer(question: Question[_T]) -> _T | None:
    """The answer; a warning and None where there is none."""
    from stlbench.rollout.questions import answers
    from stlbench.study.plugin_guard import ask

    answer: _T | None = answers([question], ask).get(question)
    return answer


def _scored(score: Score | None) -> dict[str, float] | None:
    """What the hand controller gets from the report's starts, None without one; satisfaction in [0, 1]."""
    return None if score is None else _mean(score) | {"robustness_min": score.minimum}


def _mean(score: Score) -> dict[str, float]:
    return {"robustness_mean": score.mean, "satisfaction": score.satisfaction}


def _baselines(task: Task) -> dict[str, Any] | None:
    """What constant actions and random ones get from the report's starts; None where they cannot be scored."""
    from stlbench.rollout.standards import at_random, constant_actions

    constants, random = _answer(constant_actions(task.choice)), _answer(at_random(task.choice))
    if constants is None or random is None:
        return None
    return {
        "trivial": constants.trivial,
        "zero": _mean(constants.zero),
        "constant": _mean(constants.best) | {"action": constants.action},
        "random": _mean(random),
    }


def _terms(task: Task) -> list[dict[str, Any]] | str:
    """The terms of eq. 2 with the range of each rho over the signals' box; why not, where there are none."""
    from stlbench.contract import Unsuitable

    try:
        terms = task.specification.terms
    except Unsuitable as reason:
        return one_line(reason)
    ranges = [task.specification.range(term.psi) for term in terms]
    return [
        {"formula": str(term.formula), "rho_min": low, "rho_max": high}
        for term, (low, high) in zip(terms, ranges, strict=True)
    ]


def _methods(task: Task) -> dict[str, Any]:
    from stlbench.registry import plugins

    methods = {}
    for name in plugins.available("methods"):
        try:
            methods[name] = _method(task, name)
        except plugins.PluginError as error:
            warn(str(error))
    return methods


def _method(task: Task, name: str) -> dict[str, Any]:
    """What a method with its default parameters makes of the task; status and reason where it does not fit."""
    from stlbench.contract.presentation import Described

    found = fit(task, name)
    if (method := found.method) is None:
        return {"status": found.status, "reason": found.reason}
    try:
        described = dict(method.describe()) if isinstance(method, Described) else {}
    except Exception as error:
        return {"status": "raised", "reason": cause(error)}
    return {"status": "suitable", "inputs_added": method.input_size, "scale": method.scale} | described
