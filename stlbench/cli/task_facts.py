"""The facts of `stlbench show task`: the file, what the controller and the baselines get, what methods make of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from stlbench import stl
from stlbench.cli.common import warn
from stlbench.contract import System, Unsuitable
from stlbench.contract.presentation import Described
from stlbench.errors import cause, one_line
from stlbench.records.fields import safe_line
from stlbench.records.identity import Track
from stlbench.records.result import Score
from stlbench.registry import plugins
from stlbench.rollout.baselines import Constants
from stlbench.rollout.haste import too_fast
from stlbench.rollout.observing import size_without
from stlbench.rollout.questions import Question, answers
from stlbench.rollout.rewrites import alternatives
from stlbench.rollout.standards import at_random, by_hand, constant_actions, differences
from stlbench.schedules.derive import UnscheduledError
from stlbench.study.fitting import fit
from stlbench.study.plugin_guard import ask
from stlbench.task.task import Task

_AS_STATED = ("title", "source", "notes", "steps", "sampling_time", "hold", "starts", "robots", "agents")
"""What the facts have as the task file states it."""


def task_facts(task: Task, track: Track) -> dict[str, Any]:
    """All that `stlbench show task` says of a task on a track, as JSON values. Intervals of formulas are in steps."""
    file, system = task.file, task.dynamics if isinstance(task.dynamics, System) else None
    beyond = system.beyond_state if system and file.features == "engineered" else ()
    questions: list[Question[Any]] = [question(task.choice) for question in (by_hand, constant_actions, at_random)]
    answered = answers(questions, ask)
    controller, constants, random = map(answered.get, questions)
    actions = _dumped(file.actions) or {axis.name: axis.ends for axis in task.source.axes}
    return {
        **{name: getattr(file, name) for name in _AS_STATED},
        "formula": str(task.formula),
        "rewarded": None if file.rewarded is None else str(file.rewarded),
        "schedule": _schedule(task) if track == "auto" else None,
        "horizon": stl.horizon(task.formula),
        # a policy's view: "engineered" or "state" of a system, "observation" of anything else, "formula" of both
        "features": file.features if system or task.view else "observation",
        "environment": None if file.environment is None else file.environment.id,
        "beyond_state": task.view.quantities if task.view else beyond,
        "observation_size": size_without(task) if task.view else None,
        "controller": None if controller is None else _mean(controller) | {"robustness_min": controller.minimum},
        "baselines": None if constants is None or random is None else _baselines(constants, random),
        "best_known": None if file.best_known is None else file.best_known.model_dump(),
        "signals": _dumped(file.signals),
        "terms": _terms(task),
        "actions": actions,
        "training": file.training.model_dump(exclude_none=True),
        "budgets": _dumped(file.budgets),
        "protocols": {
            key: {
                "title": each.title,
                "formula": str(file.formula if each.formula is None else each.formula),
                "starts": each.starts,
            }
            for key, each in file.protocols.items()
        },
        "own_agent": task.own_agent,
        "methods": _methods(task),
        "equal_rewards": [
            dict(vars(difference)) for difference in differences(task.choice, plugins.available("methods"), ask, track)
        ],
    }


def _schedule(task: Task) -> dict[str, Any] | str | None:
    """The windows that training follows; why there are none; None where they are the formula's own."""
    try:
        found = alternatives(task)
    except UnscheduledError as error:
        return one_line(error)
    if task.file.schedule is None:
        return None
    windows = [
        {
            "condition": str(term.psi),
            "asks": {"F": "at one step", "FG": f"for {term.length - 1} steps", "G": "all the time"}[term.kind],
            "begin": term.start,
            "end": term.end,
        }
        for term in found[0].terms
    ]
    facts = {"steps_per_unit": found[0].pace, "alternatives": len(found), "windows": windows}
    return facts | {"warning": too_fast(task)}


def _dumped(parts: Mapping[str, BaseModel]) -> dict[str, dict[str, Any]]:
    return {name: part.model_dump(exclude_none=True) for name, part in parts.items()}


def _mean(score: Score) -> dict[str, float]:
    return {"robustness_mean": score.mean, "satisfaction": score.satisfaction}


def _baselines(constants: Constants, random: Score) -> dict[str, Any]:
    return {
        "trivial": constants.trivial,
        "zero": _mean(constants.zero),
        "constant": _mean(constants.best) | {"action": constants.action},
        "random": _mean(random),
    }


def _terms(task: Task) -> list[dict[str, Any]] | str:
    """The terms of eq. 2 with the range of each rho over the signals' box, or the reason why there are none."""
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
    methods = {}
    for name in plugins.available("methods"):
        try:
            methods[name] = _method(task, name)
        except plugins.PluginError as error:
            warn(str(error))
    return methods


def _method(task: Task, name: str) -> dict[str, Any]:
    """The description of a method with default parameters, or the status and reason why it does not fit."""
    fitted = fit(task, name)
    if (method := fitted.method) is None:
        return {"status": fitted.status, "reason": fitted.reason}
    try:
        described = _safe(dict(method.describe())) if isinstance(method, Described) else {}
    except Exception as error:
        return {"status": "raised", "reason": cause(error)}
    return {"status": "suitable", "inputs_added": method.input_size, "scale": method.scale} | described


def _safe(told: Any) -> Any:
    """What a plugin says, numbers, texts or lists, with texts that are safe to show."""
    if isinstance(told, Mapping):
        return {safe_line(str(name)): _safe(part) for name, part in told.items()}
    if isinstance(told, list | tuple):
        return [_safe(part) for part in told]
    return told if told is None or isinstance(told, int | float) else safe_line(str(told))
