"""`stlbench show task`: what a task asks, what its controller and baselines get, what methods make of it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

from stlbench.cli.advise import fit
from stlbench.cli.common import Json, show, warn
from stlbench.cli.options import TaskName
from stlbench.cli.show_task_text import task_text
from stlbench.errors import cause, one_line

if TYPE_CHECKING:
    from stlbench.records.identity import Track
    from stlbench.records.result import Score
    from stlbench.rollout.questions import Question
    from stlbench.task.task import Task

_T = TypeVar("_T")


def task(
    name: TaskName,
    track: Annotated[
        Literal["auto", "shared", "plain"] | None,
        typer.Option(
            metavar="NAME",
            help="As `stlbench run --track` trains it.",
            show_default="shared; auto for a task without a recipe",
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Show a task: formula, signals, actions, training, budgets, controller and baselines, what methods make of it.

    \b
    Examples:
      stlbench show task reach-stay
      stlbench show task robot-nav --track auto
      stlbench show task ./my-task --json
    """
    from stlbench.registry import plugins
    from stlbench.registry.choices import Choice
    from stlbench.study.tracks import on_track, own_agent_on
    from stlbench.task import load_task

    loaded = load_task(name)
    on = track or loaded.own_track
    loaded = on_track(loaded, Choice(own_agent_on(loaded, on)), on)
    plugin = plugins.find("tasks", loaded.choice.name)
    facts = {"name": loaded.name, "distribution": plugin.distribution, "version": plugin.version} | _facts(loaded, on)
    show(as_json, facts, task_text(facts))


def _facts(task: Task, track: Track) -> dict[str, Any]:
    """Intervals of formulas are in steps."""
    from stlbench import stl
    from stlbench.registry import plugins
    from stlbench.rollout.standards import by_hand, differences
    from stlbench.study.plugin_guard import ask

    file, controller = task.file, _answer(by_hand(task.choice))
    return {
        "title": file.title,
        "source": file.source,
        "notes": " ".join(file.notes.split()),
        "formula": str(task.formula),
        "rewarded": None if file.rewarded is None else str(file.rewarded),
        "horizon": stl.horizon(task.formula),
        "steps": file.steps,
        "sampling_time": file.sampling_time,
        "hold": file.hold,
        "starts": file.starts,
        "features": _features(task),
        "environment": None if file.environment is None else file.environment.id,
        "beyond_state": _beyond_state(task),
        "controller": None if controller is None else _mean(controller) | {"robustness_min": controller.minimum},
        "baselines": _baselines(task),
        "best_known": None if file.best_known is None else file.best_known.model_dump(),
        "signals": {name: signal.model_dump(exclude_none=True) for name, signal in file.signals.items()},
        "terms": _terms(task),
        "actions": _actions(task),
        "robots": file.robots,
        "training": file.training.model_dump(exclude_none=True),
        "budgets": {name: budget.model_dump(exclude_none=True) for name, budget in file.budgets.items()},
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
            dict(vars(difference)) for difference in differences(task.choice, plugins.available("methods"), ask, track)
        ],
    }


def _features(task: Task) -> str:
    """A policy's view: "engineered" or "state" of a system, "observation" of anything else, or "formula" of both."""
    from stlbench.contract import System

    return task.file.features if isinstance(task.dynamics, System) or task.view else "observation"


def _beyond_state(task: Task) -> tuple[str, ...]:
    from stlbench.contract import System

    if task.view is not None:
        return task.view.quantities
    dynamics, engineered = task.dynamics, task.file.features == "engineered"
    return dynamics.beyond_state if isinstance(dynamics, System) and engineered else ()


def _actions(task: Task) -> dict[str, dict[str, Any]]:
    declared = {name: axis.model_dump(exclude_none=True) for name, axis in task.file.actions.items()}
    return declared or {axis.name: axis.ends for axis in task.source.axes}


def _answer(question: Question[_T]) -> _T | None:
    from stlbench.rollout.questions import answers
    from stlbench.study.plugin_guard import ask

    answer: _T | None = answers([question], ask).get(question)
    return answer


def _mean(score: Score) -> dict[str, float]:
    return {"robustness_mean": score.mean, "satisfaction": score.satisfaction}


def _baselines(task: Task) -> dict[str, Any] | None:
    """The scores of constant and of random actions from the report's starts; None if they cannot be scored."""
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
    """The terms of eq. 2 with the range of each rho over the signals' box, or the reason why there are none."""
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
    """The description of a method with default parameters, or the status and reason why it does not fit."""
    from stlbench.contract.presentation import Described

    fitted = fit(task, name)
    if (method := fitted.method) is None:
        return {"status": fitted.status, "reason": fitted.reason}
    try:
        described = dict(method.describe()) if isinstance(method, Described) else {}
    except Exception as error:
        return {"status": "raised", "reason": cause(error)}
    return {"status": "suitable", "inputs_added": method.input_size, "scale": method.scale} | described
