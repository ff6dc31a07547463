"""Names of signals and of robustness on axes, with their units."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from stlbench import stl
from stlbench.errors import UsageError
from stlbench.registry.choices import Choice
from stlbench.stl.language.structure import walk
from stlbench.task.task import Task

Load = Callable[[Choice | str], Task]
"""Loads a task; raises `UsageError` where that is not possible."""
NO_UNIT = "-"
"""Where the task file names none."""
UNKNOWN = "unit of the predicates"
_SAME_UNIT = ("abs", "min", "max", "norm", "norminf")
"""Functions whose value has the unit of their arguments."""


def signal_label(task: Task, name: str) -> str:
    """The signal with its unit: x [m]."""
    return f"{name} [{task.file.signals[name].unit or NO_UNIT}]"


def time_label(task: Task) -> str:
    """Of the time axis."""
    return f"time [steps of {task.file.sampling_time:g} s]"


def robustness_unit(task: Task, formula: stl.Formula) -> str:
    """The unit in which the robustness of `formula` is: "m"; "rad or rad/s" where predicates have different ones.

    "unit of the predicates" where a predicate is no sum, difference, multiple or norm of signals of one unit.
    """
    units = dict[str, None]()  # a set that keeps the order
    for node in walk(formula):
        if isinstance(node, stl.Predicate):
            both = [_unit(task, node.left), _unit(task, node.right)]
            named = {unit for unit in both if unit != ""}
            if len(named) != 1 or None in named:
                return UNKNOWN
            units |= {unit: None for unit in named if unit is not None}
    return " or ".join(units) or UNKNOWN


def _unit(task: Task, expression: stl.Expression) -> str | None:
    """The unit of an expression; empty for constants, None where it is none of the signals' units."""
    match expression:
        case stl.Number():
            return ""
        case stl.Signal(name):
            return task.file.signals[name].unit or NO_UNIT
        case stl.Negative(arg):
            return _unit(task, arg)
        case stl.Binary("*", stl.Number(), part) | stl.Binary("*" | "/", part, stl.Number()):
            return _unit(task, part)
        case stl.Binary("+" | "-", left, right):
            parts = {_unit(task, left), _unit(task, right)}
        case stl.Call(name, args) if name in _SAME_UNIT:
            parts = {_unit(task, arg) for arg in args}
        case _:
            return None
    named = parts - {""}
    return named.pop() if len(named) == 1 else None if named else ""


class Scale(NamedTuple):
    """What an axis of a task's robustness says."""

    unit: str
    most: float
    """No trace within the signals' ranges has more robustness; inf where nothing is known."""


def scale_of_task(choice: Choice | str, load: Load) -> Scale:
    """Of the robustness of a task's formula; "unit of the predicates" where the task is not installed here."""
    try:
        task = load(choice)
    except UsageError:
        return Scale(UNKNOWN, math.inf)
    return Scale(robustness_unit(task, task.formula), _most(task, task.formula))


def _most(task: Task, formula: stl.Formula) -> float:
    """An upper bound of the robustness, from the ranges of the signals: parts may be read at different times."""
    if not stl.is_temporal(formula):
        try:
            return task.specification.range(formula)[1]
        except stl.UndefinedError:
            return math.inf
    match formula:
        case stl.And(args):
            return min(_most(task, arg) for arg in args)
        case stl.Or(args):
            return max(_most(task, arg) for arg in args)
        case stl.Always(_, _, arg) | stl.Eventually(_, _, arg) | stl.Until(_, _, _, arg):
            return _most(task, arg)
        case _ if (pushed := stl.negations_inside(formula)) != formula:
            return _most(task, pushed)
    return math.inf
