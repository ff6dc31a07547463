"""The problem to solve, and the content of its task file: from an environment and a formula. All that is wrong
is said, also that no episode can satisfy the formula.

Each rule is sound: a reason is a proof, as far as the ranges are true. None proves nothing.
"""

import re
from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from stlbench import stl
from stlbench.errors import UsageError, did_you_mean, one_line
from stlbench.registry import named_tasks, plugins
from stlbench.stl import Always, And, Eventually, Formula, Once, Or, Since, Until
from stlbench.stl.language.structure import negations_inside, unbounded, walk
from stlbench.task.file import EarlyEnd, Environment, TaskFile
from stlbench.task.gym_sketch import info_ends, sketch
from stlbench.task.task import load_task

Box = Mapping[str, tuple[float, float]]
"""Signal -> its range."""
_NODES = 2000
"""Boxes that a proof may examine."""
_MOST = 100
"""Conjunctions that are looked at."""


@dataclass(frozen=True)
class _Demand:
    """A part without temporal operators that every satisfying episode meets."""

    psi: Formula
    begin: int
    end: int
    throughout: bool
    """At all of the samples begin..end, or at one of them."""

    @property
    def text(self) -> str:
        first = f"sample {self.begin}" if self.begin == self.end else f"samples {self.begin} to {self.end}"
        one = "one of " if not self.throughout and self.begin < self.end else ""
        return f"'{self.psi}' at {one}{first}"


def why_impossible(formula: Formula, box: Box) -> str | None:
    """The reason, in words; None where none is known. Intervals of the formula are in steps."""
    pushed = negations_inside(formula)
    return _nowhere(pushed, box) or _conflict(list(_demands(pushed, 0, 0, True)), box)


def _nowhere(formula: Formula, box: Box) -> str | None:
    """Why a formula holds at no sample."""
    if not stl.is_temporal(formula):
        return _beyond(formula, box)
    match formula:
        case And(args):
            return next(filter(None, (_nowhere(arg, box) for arg in args)), None)
        case Or(args):
            reasons = [_nowhere(arg, box) for arg in args]
            return "; ".join(filter(None, reasons)) if all(reasons) else None
        case Always(arg=arg) | Eventually(arg=arg) | Once(arg=arg):
            return _nowhere(arg, box)
        case Until(right=right) | Since(right=right):
            return _nowhere(right, box)
    return None


def _beyond(psi: Formula, box: Box) -> str | None:
    """Why a part holds nowhere within the ranges."""
    if not _holds_nowhere(psi, box):
        return None
    ends = ", ".join(f"{name} is from {box[name][0]:g} to {box[name][1]:g}" for name in stl.signals(psi))
    return f"'{psi}' never holds: {ends}"


def _holds_nowhere(psi: Formula, box: Box) -> bool:
    try:
        return stl.bounds(psi, box, nodes=_NODES).high < 0
    except ValueError:  # no proof: it is not defined all over the box
        return False


def _demands(formula: Formula, begin: int, end: int, throughout: bool) -> Iterator[_Demand]:
    """The consequences of a formula that holds at all the samples begin..end, or at one of them."""
    if not stl.is_temporal(formula):
        yield _Demand(formula, begin, end, throughout)
        return
    surely = throughout or begin == end
    match formula:
        case And(args):
            for arg in args:
                yield from _demands(arg, begin, end, throughout)
        case Always(a, b, arg) if surely:
            yield from _demands(arg, begin + a, end + b, True)
        case Always(a, b, arg) if end + a <= begin + b:  # whichever the sample is, these are among its own
            yield from _demands(arg, end + a, begin + b, True)
        case Eventually(a, b, arg) if surely:
            for sample in {begin, end}:  # fewer demands than there are prove less, and nothing false
                yield from _demands(arg, sample + a, sample + b, False)
        case Eventually(a, b, arg):
            yield from _demands(arg, begin + a, end + b, False)
        case Until(a, b, left, right) if surely:
            if a > 0:  # else the right operand may hold at once
                yield from _demands(left, begin, end + a - 1, True)
            yield from _demands(right, begin + a, begin + b, False)


def _conflict(demands: Sequence[_Demand], box: Box) -> str | None:
    """Why these cannot be met together."""
    held = [demand for demand in demands if demand.throughout or demand.begin == demand.end]
    known = set[Formula]()
    for demand in demands:
        others = [each for each in held if each is not demand and each.begin <= demand.end and demand.begin <= each.end]
        if others and (reason := _against(demand, others, box, known)):
            return reason
    return None


def _against(demand: _Demand, others: Sequence[_Demand], box: Box, known: set[Formula]) -> str | None:
    """Why a demand has no sample at which it goes with the others; `known` are conjunctions that are possible."""
    within = [min(max(edge, demand.begin), demand.end + 1) for each in others for edge in (each.begin, each.end + 1)]
    edges = sorted({demand.begin, demand.end + 1, *within})
    ruled_out = list[_Demand]()
    for begin, _ in pairwise(edges):
        there = [each for each in others if each.begin <= begin <= each.end]
        conjunction = And((demand.psi, *(each.psi for each in there))) if there else None
        if conjunction is None or conjunction in known or len(known) >= _MOST or not _holds_nowhere(conjunction, box):
            known |= {conjunction} if conjunction is not None else set()
            if not demand.throughout:
                return None
            continue
        ruled_out += [each for each in there if each not in ruled_out]
        if demand.throughout:
            break
    if not ruled_out:
        return None
    return f"{demand.text} contradicts {' and '.join(each.text for each in ruled_out)}"


_NOTHING = 1e-300  # bounds are rounded outward, 0 too
_DECISIONS = 200
"""An action is held for as many steps as leave at most so many decisions in an episode."""
_WIDER = 1e6
"""No policy leaves a range that random actions showed, made wider by this factor."""
_BY_HAND = {
    *("notes", "rewarded", "nested", "schedule", "schedules", "training", "features"),
    *("best_known", "baselines", "protocols", "budgets"),
}
"""The keys of a task file for training or for another formula. The track `auto` derives its own."""
_ENTRY = re.compile(r"\bobs\[(\w+)\](?:\[(\d+)\])?")
_VERSION = re.compile(r"-v\d+$")


@dataclass(frozen=True)
class Problem:
    """The user's request."""

    environment: str
    """An id of Gymnasium; or a task, by its name or its folder's path."""
    formula: str | None
    """None for the task's own."""
    signals: Mapping[str, str] = field(default_factory=dict)
    """Signal -> expression over entries of the observation, of which `obs[0]` is the first, and over the info."""
    time: Literal["steps", "seconds"] | None = None
    """Unit of the formula's intervals; None for steps, or what the task's file says."""
    terminated: EarlyEnd | None = None
    """The meaning of an early end; by the formula where None."""
    keywords: Mapping[str, Any] = field(default_factory=dict)
    """The arguments that make the environment."""
    start: str | None = None
    """The hash of the policy from which trainings start."""
    seed: int = 0
    """A try with other seeds, where not 0."""

    @property
    def facts(self) -> dict[str, Any]:
        """As `solve.json` has it."""
        return {name: value for name, value in asdict(self).items() if name not in ("start", "seed") or value}


def content_of(problem: Problem, seconds: float | None = None) -> dict[str, Any]:
    """The content of its task file, without budgets. A slow environment is played for about so many seconds.

    Raises `UsageError`: no such environment or task, a formula that does not fit it, a constant signal.
    """
    return _of_task(problem) if _is_task(problem.environment) else _of_environment(problem, seconds)


def code_beside(problem: Problem) -> Mapping[str, bytes]:
    """The code beside the task file, file -> content: that of the task's own folder, or a class that inherits from the
    installed one. Raises `UsageError` where there is no such task."""
    if not _is_task(problem.environment):
        return {}
    task = load_task(problem.environment)
    kind = type(task.dynamics)
    if (place := named_tasks.place_of(task.choice.name)) is not None:
        return {path.name: path.read_bytes() for path in place.glob("*.py") if path.is_file()}
    if kind.__module__.endswith("."):  # a task that is a file alone has no class
        return {}
    lines = f'"""The dynamics of the task {task.name}."""\n\nfrom {kind.__module__} import {kind.__name__} as Base\n'
    return {"system.py": f'{lines}\n\nclass Solved(Base):\n    """The same."""\n'.encode()}


def given_to_code(source: Problem | TaskFile) -> Mapping[str, Any]:
    """The values that a task file gives to code: the environment and its arguments, or the parameters of a system.

    Raises `UsageError` where there is no such task.
    """
    if isinstance(source, Problem):
        if _is_task(source.environment):
            return given_to_code(load_task(source.environment).file)
        environment, parameters = Environment(id=source.environment, kwargs=dict(source.keywords)), dict[str, Any]()
    else:
        environment, parameters = source.environment or Environment(), source.parameters
    return {"parameters": parameters, **environment.model_dump(include={"id", "api", "kwargs", "drawn"})}


def _is_task(name: str) -> bool:
    """A path is a task, unless it is no folder and has a version: ids of Gymnasium have slashes too, `ALE/Pong-v5`."""
    if named_tasks.is_path(name):
        return Path(name).is_dir() or _VERSION.search(name) is None
    return plugins.known("tasks", name) is not None


# ------------------------------------------------------------------------------------------------------------ of a task


def _of_task(problem: Problem) -> dict[str, Any]:
    """The content of the file of a task, without what helps by hand."""
    if problem.signals:
        raise UsageError(f"{problem.environment} is a task with its own signals; --signal is for an environment")
    task = load_task(problem.environment)
    content = task.file.model_dump(exclude_defaults=True, exclude=_BY_HAND)
    content["time"] = "steps"
    if problem.formula is not None:
        seconds = (problem.time or task.file.time) == "seconds"
        formula = _formula(problem.formula, task.file.sampling_time if seconds else None, set(task.signals))
        _check_horizon(formula, task.file.steps, problem.environment)
        _refuse_impossible(formula, task.file.box)
        content["formula"], content["title"] = str(formula), f"{problem.formula} on {problem.environment}"
    if problem.terminated is not None:
        content["terminated"] = problem.terminated
    return content


# ---------------------------------------------------------------------------------------------------- of an environment


def _of_environment(problem: Problem, seconds: float | None) -> dict[str, Any]:
    """The content of a task file on an environment of Gymnasium."""
    if problem.formula is None:
        name, tasks = problem.environment, plugins.available("tasks")
        similar = "" if _VERSION.search(name) else did_you_mean(name, tasks)
        raise UsageError(f"{name} is no task, and an environment has no formula of its own; give one{similar}")
    content = sketch(problem.environment, problem.keywords, seconds, timed=problem.time == "seconds")
    entries = {name: (ends["low"], ends["high"]) for name, ends in content["signals"].items()}
    texts = {name: _expression(name, text, content["environment"]["names"]) for name, text in problem.signals.items()}
    dt = content["sampling_time"] if problem.time == "seconds" else None
    told = dict[str, tuple[float, float]]()
    if not {*_names(texts), *stl.signals(_parsed(problem.formula, dt))} <= {*texts, *entries}:
        told = info_ends(problem.environment, problem.keywords, seconds)
        entries |= told
    formula = _formula(problem.formula, dt, {*texts, *entries})
    _check_horizon(formula, content["steps"], problem.environment)
    horizon = content["steps"] if unbounded(formula) is not None else stl.horizon(formula)
    hold = -(-horizon // _DECISIONS)
    steps = -(-horizon // hold) * hold
    used = [*texts, *(name for name in stl.signals(formula) if name not in texts)]
    ends = {name: _ends(name, texts.get(name, name), entries) for name in used}
    seen = {*content["environment"].get("scale", ()), *(name for name, pair in told.items() if pair != (0, 1))}
    _refuse_impossible(formula, {name: _surely(texts.get(name, name), ends[name], seen) for name in used})
    # an operator that asks for some time, not for all: an environment may end because something was reached
    has_goals = any(isinstance(node, stl.Eventually | stl.Until) for node in walk(formula))
    return content | {
        "title": f"{problem.formula} on {problem.environment}",
        "formula": str(stl.resolve_end(formula, steps)),
        "time": "steps",
        "steps": steps,
        "hold": hold,
        "terminated": problem.terminated or ("hold" if has_goals else "violated"),
        "signals": {name: _signal(name, texts.get(name), ends[name]) for name in used},
    }


def _expression(name: str, text: str, names: Any) -> str:
    """The text with the names of entries in place of `obs[0]`, and of `obs[key][0]` in a Dict observation."""

    def entry(match: re.Match[str]) -> str:
        key, place = match.groups()
        if isinstance(names, list):
            counts = place is None and key.isascii() and key.isdecimal()
            several, index = names, int(key) if counts else len(names)
        else:
            several, index = names.get(key, ()), int(place or 0)
            index = index if (place or "").isascii() else len(several)
        if index >= len(several):
            known = f"obs[0] to obs[{len(names) - 1}]" if isinstance(names, list) else f"obs[{'], obs['.join(names)}]"
            raise UsageError(f"signal {name}: there is no {match[0]}; the observation has {known}")
        return str(several[index])

    return _ENTRY.sub(entry, text)


def _names(texts: Mapping[str, str]) -> Iterator[str]:
    """The names in expressions."""
    for name, text in texts.items():
        try:
            yield from stl.signals(stl.parse_expression(text))
        except (ValueError, TypeError) as error:
            raise UsageError(f"signal {name}: {error}") from error


def _ends(name: str, text: str, entries: Mapping[str, tuple[float, float]]) -> tuple[float, float]:
    """The range of a signal, which follows from the ranges of the entries in its expression."""
    try:
        ends = stl.bounds(stl.parse(f"{text} >= 0"), entries, nodes=2000)
    except ValueError as error:
        raise UsageError(f"signal {name}: {one_line(error)}") from error
    if not np.isfinite([ends.low, ends.high]).all():
        raise UsageError(f"signal {name}: {text} is without ends where {entries}")
    return ends.low, ends.high


def _signal(name: str, text: str | None, ends: tuple[float, float]) -> dict[str, Any]:
    """An entry of `signals`."""
    low, high = (float(f"{end:.4g}") if abs(end) > _NOTHING else 0.0 for end in ends)
    if not low < high:
        raise UsageError(f"signal {name} is constant, {low:g}; a formula is over signals that change")
    return {"low": low, "high": high} | ({} if text is None or text == name else {"expression": text})


def _surely(text: str, ends: tuple[float, float], seen: Set[str]) -> tuple[float, float]:
    """A range that no sample leaves. The ends of some entries are only by what random actions showed, as `seen`."""
    if seen.isdisjoint(stl.signals(stl.parse_expression(text))):
        return ends
    most = _WIDER * max(map(abs, ends))
    return -most, most


# --------------------------------------------------------------------------------------------------------- the formula


def _parsed(text: str, dt: float | None = None) -> stl.Formula:
    try:
        return stl.parse(text, dt=dt)
    except (ValueError, TypeError) as error:
        raise UsageError(f"formula: {error}") from error  # it has several lines, with a caret below the place


def _formula(text: str, dt: float | None, known: set[str]) -> stl.Formula:
    formula = _parsed(text, dt)
    for name in stl.signals(formula):
        if name not in known:
            raise UsageError(f"formula: no signal '{name}'{did_you_mean(name, known)}")
    return formula


def _refuse_impossible(formula: stl.Formula, box: Mapping[str, tuple[float, float]]) -> None:
    if reason := why_impossible(formula, box):
        raise UsageError(f"formula: it is impossible: {reason}")


def _check_horizon(formula: stl.Formula, steps: int, environment: str) -> None:
    try:
        stl.resolve_end(formula, steps)
    except ValueError as error:
        raise UsageError(f"formula: {error}") from error
    if unbounded(formula) is not None:
        return
    if not (horizon := stl.horizon(formula)):
        rule = "no action changes it; say when, as in F[0,100] or G[0,100]"
        raise UsageError(f"formula: the first sample of an episode decides it, and {rule}")
    if horizon > steps:
        raise UsageError(f"formula: it looks {horizon} steps ahead, and an episode of {environment} has {steps}")
