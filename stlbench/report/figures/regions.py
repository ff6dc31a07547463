"""A task's formula and signals in pictures: where and when its parts hold, and the units of axes."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Truth, Unsuitable
from stlbench.errors import UsageError
from stlbench.registry.choices import Choice
from stlbench.stl import Always, And, Eventually, Formula, Or, Release, Term, Until
from stlbench.stl.language.structure import walk
from stlbench.task.task import Task

Load = Callable[[Choice | str], Task]  # loads a task; raises `UsageError` if that is not possible
_SAMPLES, _MOST_VALUES, _MOST_OTHERS = 2_000_000, 801, 4
"""At most, in a picture: computed points, values of each signal that it leaves out, and such signals."""


class Condition(NamedTuple):
    """A part of a formula without temporal operators, as large as there is."""

    psi: Formula
    start: int  # the first step at which it can be read
    end: int  # the last
    operators: tuple[str, ...]  # the temporal operators around it, from outside: G[0,900], F[0,99]

    def __str__(self) -> str:
        return " ".join([*self.operators, str(self.psi)])


def parts(task: Task) -> tuple[Condition, ...]:
    """The parts of the task's own formula, in their order; of one in the fragment of eq. 2, one for each term.

    In temporal formulas, negations and implications are pushed inside first.
    """
    return tuple(_parts(Condition(task.formula, 0, 0, ())))


def _parts(within: Condition) -> Iterator[Condition]:
    formula = within.psi
    if not stl.is_temporal(formula):
        yield within
        return
    match formula:
        case And(args) | Or(args):
            for arg in args:
                yield from _parts(within._replace(psi=arg))
        case Always(a, b, arg) | Eventually(a, b, arg):
            yield from _parts(_inside(within, f"{formula.letter}[{a},{b}]", arg, a, b))
        case Until(a, b, left, right) | Release(a, b, left, right):
            word = "until" if isinstance(formula, Until) else "releases"
            letter = word[0].upper()
            yield from _parts(_inside(within, f"{word} {letter}[{a},{b}]", left, 0, b))
            yield from _parts(_inside(within, f"{letter}[{a},{b}]", right, a, b))
        case _ if (pushed := stl.negations_inside(formula)) != formula:
            yield from _parts(within._replace(psi=pushed))
        case _:  # of the past, which has no steps of its own
            return


def _inside(within: Condition, operator: str, arg: Formula, a: int, b: int) -> Condition:
    return Condition(arg, within.start + a, within.end + b, (*within.operators, operator))


def terms(task: Task) -> tuple[Term, ...]:
    """The terms of the task's own formula, which the referee scores; none if it is outside the fragment of eq. 2."""
    try:
        return stl.fragment(task.formula)
    except stl.FragmentError:
        return ()


def rewarded_terms(task: Task) -> tuple[Term, ...]:
    """The terms that reward methods see: of the task file's `rewarded` form if it has one."""
    try:
        return task.specification.terms
    except Unsuitable:
        return ()


def region(
    task: Task, psi: Formula, axes: Sequence[Array], names: Sequence[str], at: Array | None = None
) -> tuple[Array, Truth] | None:
    """The margin of `psi`, which has no temporal operators, over a grid of one signal or two, and where it holds.

    Other signals that psi reads have their values in the sample `at` (k,). Without it they take the best of a few
    values in their ranges: a region in the plane is the projection of the region in space. Both results have shape
    (p_1, p_2) or (p_1,). None if psi reads none of these signals, or more than four others to search.
    """
    read, specification = stl.signals(psi), task.specification
    hidden = [name for name in task.signals if name in read and name not in names]
    if (at is None and len(hidden) > _MOST_OTHERS) or not set(read) & set(names):
        return None
    few = min(_MOST_VALUES, (_SAMPLES / math.prod(map(len, axes))) ** (1 / max(1, len(hidden))))
    count = 1 if at is not None else int(few) // 2 * 2 + 1  # with the middle of the range among them
    low, high = (specification.low, specification.high) if at is None else (at, at)
    values = [
        axes[list(names).index(name)] if name in names else np.linspace(low, high, count if name in hidden else 1)
        for name, low, high in zip(task.signals, low, high, strict=True)
    ]
    samples = np.stack(np.meshgrid(*values, indexing="ij"), axis=-1)
    left_out = tuple(i for i, name in enumerate(task.signals) if name not in names)
    margin = specification.margin(psi)(samples).max(axis=left_out)
    truth: Truth = np.asarray(specification.holds(psi)(samples).any(axis=left_out))
    if [name for name in task.signals if name in names] != list(names):
        margin, truth = margin.T, truth.T
    return margin, truth


NO_UNIT = "-"  # if the task file names none
UNKNOWN = "unit of the predicates"
_SAME_UNIT = ("abs", "min", "max", "norm", "norminf")  # functions whose value has the unit of their arguments


def signal_label(task: Task, name: str) -> str:
    return f"{name} [{task.file.signals[name].unit or NO_UNIT}]"


def time_label(task: Task) -> str:
    return f"time [steps of {task.file.sampling_time:g} s]"


def robustness_unit(task: Task, formula: stl.Formula) -> str:
    """The unit of a formula's robustness: "m"; "rad or rad/s" if predicates have different ones.

    "unit of the predicates" if a predicate is no sum, difference, multiple or norm of signals of one unit.
    """
    units = list[str]()
    for node in walk(formula):
        if isinstance(node, stl.Predicate):
            unit = _common(task, (node.left, node.right))
            if not unit:
                return UNKNOWN
            units.append(unit)
    return " or ".join(dict.fromkeys(units)) or UNKNOWN


def _common(task: Task, expressions: Sequence[stl.Expression]) -> str | None:
    """The unit of all these expressions; empty if all are constants, None if they have none in common."""
    units = {_unit(task, each) for each in expressions} - {""}
    return units.pop() if len(units) == 1 else None if units else ""


def _unit(task: Task, expression: stl.Expression) -> str | None:
    """The unit of an expression; empty for constants, None if it is none of the signals' units."""
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
            return _common(task, (left, right))
        case stl.Call(name, args) if name in _SAME_UNIT:
            return _common(task, args)
    return None


class Scale(NamedTuple):
    unit: str
    most: float  # no trace within the signals' ranges has more robustness; inf if nothing is known


def scale_of_task(choice: Choice | str, load: Load) -> Scale:
    """The scale of the robustness of a task's formula; "unit of the predicates" if the task is not installed here."""
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
        case And(args):
            return min(_most(task, arg) for arg in args)
        case Or(args):
            return max(_most(task, arg) for arg in args)
        case Always(_, _, arg) | Eventually(_, _, arg) | Until(_, _, _, arg):
            return _most(task, arg)
        case _ if (pushed := stl.negations_inside(formula)) != formula:
            return _most(task, pushed)
    return math.inf
