"""What is to be solved: from an environment and a formula to a task file, with all that is wrong said before."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml

from stlbench import stl
from stlbench.contract import GymTask
from stlbench.errors import UsageError, did_you_mean, one_line
from stlbench.records.outputs import write
from stlbench.records.result import Score
from stlbench.registry import folders, plugins
from stlbench.registry.choices import Choice
from stlbench.rollout import baselines
from stlbench.solver import tries, witness
from stlbench.stl.language.structure import unbounded, walk
from stlbench.task import Task, load_task
from stlbench.task.file import EarlyEnd
from stlbench.task.gym_sketch import info_ends, sketch

TASK = Choice("task")
"""The folder of the task file, and so the task's name."""
_ASKED, _FILE, WITNESS = "solve.json", "task.yaml", "witness.json"
_LOOK, _SEARCHED = 0.03, 15.0
"""The share of the time for each of the first tries: scores, constant actions and a witness; and the most seconds for
the last."""
_MOST_SEARCHED = 3.0
"""No witness is searched where one generation would take so many times the seconds of a search."""
_NOTHING = 1e-300  # bounds are rounded outward, 0 too
_AT_MOST, _CONSTANTS = 16, 50
"""Starts from which constant actions are compared at most, and about how many are."""
_DECISIONS = 200
"""An action is held for as many steps as leave at most so many decisions in an episode."""
_BY_HAND = {"notes", "rewarded", "nested", "training", "features", "best_known", "baselines", "protocols", "budgets"}
"""What a task file says for training or for another formula. The track `auto` derives its own."""
_ENTRY = re.compile(r"\bobs\[(\w+)\](?:\[(\d+)\])?")


@dataclass(frozen=True)
class Problem:
    """What the user asks for."""

    environment: str
    """An id of Gymnasium; or a task, by its name or its folder's path."""
    formula: str | None
    """None for the task's own."""
    signals: Mapping[str, str] = field(default_factory=dict)
    """Signal -> expression over entries of the observation, of which `obs[0]` is the first, and over the info."""
    time: Literal["steps", "seconds"] | None = None
    """Unit of the formula's intervals; None for steps, or what the task's file says."""
    terminated: EarlyEnd | None = None
    """What an early end means; by the formula where None."""
    keywords: Mapping[str, Any] = field(default_factory=dict)
    """What the environment is made with."""


@dataclass(frozen=True)
class Posed:
    """A problem whose task file is written."""

    folder: Path
    notes: tuple[str, ...]
    """What the user should know of it, in a line each."""
    episode_seconds: float
    """Of simulating an episode that does not end early, without training."""

    @property
    def task(self) -> Task:
        """As the file has it now."""
        return load_task(TASK)

    @property
    def state(self) -> dict[str, Any]:
        """The content of `solve.json`: the problem, the minutes, and the methods that race."""
        state: dict[str, Any] = json.loads((self.folder / _ASKED).read_text(encoding="utf-8"))
        return state

    def remember(self, **facts: Any) -> None:
        """Write facts into `solve.json`."""
        write(self.folder / _ASKED, json.dumps(self.state | facts, indent=1))

    def budget(self, name: str, **numbers: float | None) -> None:
        """Write a budget into the task file."""
        self._change_budgets(lambda budgets: budgets | {name: numbers})

    def begin(self, minutes: float) -> None:
        """Forget methods and budgets that were chosen for another time."""
        if self.state.get("minutes") != minutes:
            self._change_budgets(lambda budgets: {"probe": budgets["probe"]})
            self.remember(minutes=minutes, methods=None)

    def _change_budgets(self, change: Callable[[dict[str, Any]], dict[str, Any]]) -> None:
        path = self.folder / TASK.name / _FILE
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        _write(path, content | {"budgets": change(content["budgets"])})


def pose(problem: Problem, folder: Path, minutes: float = 10.0) -> Posed:
    """Write the task file of a problem, or go on with the one that is there. It takes a small part of the minutes.

    Raises `UsageError`: no such environment or task, a formula that does not fit it, a constant signal, an environment
    that ends at once, or a folder that has another problem.
    """
    asked, home = folder / _ASKED, folder / TASK.name
    if asked.is_file():
        state = json.loads(asked.read_text(encoding="utf-8"))
        if not is_of(problem, folder):
            raise UsageError(f"{folder} has another problem, {_shown(state['problem'])}; name another folder")
        folders.know(home, instead=True)
        return Posed(folder, tuple(state["notes"]), state["episode_seconds"])
    if home.exists():
        raise UsageError(
            f"{home} is there, and `stlbench solve` has not finished it; remove it, or name another folder"
        )
    try:
        notes, seconds = _posed(problem, home, 60 * minutes)
    except BaseException:
        shutil.rmtree(home, ignore_errors=True)
        raise
    state = {"problem": asdict(problem), "notes": notes, "episode_seconds": seconds}
    write(asked, json.dumps(state, indent=1))
    return Posed(folder, tuple(notes), seconds)


def is_of(problem: Problem, folder: Path) -> bool:
    """Whether `solve` worked on this problem in this folder."""
    asked = folder / _ASKED
    return asked.is_file() and bool(json.loads(asked.read_text(encoding="utf-8"))["problem"] == asdict(problem))


def _shown(problem: Mapping[str, Any]) -> str:
    return f"{problem['environment']} {problem['formula'] or ''}".strip()


def _posed(problem: Problem, home: Path, seconds: float) -> tuple[list[str], float]:
    """Write the folder of the task; notes, and the seconds of an episode."""
    content = _of_task(problem, home) if _is_task(problem.environment) else _of_environment(problem)
    content["budgets"] = {"probe": _probe(content["steps"])}
    _write(home / _FILE, content)
    folders.know(home, instead=True)
    task = load_task(TASK)
    tries.try_at_random(task)
    episode = tries.episode_seconds(task)
    if isinstance(task.dynamics, GymTask):  # each copy is stepped by itself, which may take long
        content["starts"] = int(np.clip(_LOOK * seconds / episode, tries.FEWEST, task.file.starts))
        _write(home / _FILE, content)
        task = load_task(TASK)
    found = baselines.constants(task, int(np.clip(_LOOK * seconds / (_CONSTANTS * episode), 1, _AT_MOST)))
    random = baselines.at_random(task)
    content["baselines"] = {
        "zero": _numbers(found.zero),
        "constant": _numbers(found.best) | {"action": list(found.action)},
        "random": _numbers(random),
    }
    _write(home / _FILE, content)
    given = min(_SEARCHED, _LOOK * seconds)
    nearest = witness.search(task, given) if witness.COPIES * episode <= _MOST_SEARCHED * given else None
    if nearest is not None and nearest.satisfies:
        facts = {"start": task.starts.report_and_selection()[0][0].tolist(), **asdict(nearest)}
        write(home.parent / WITNESS, json.dumps(facts))
    return list(tries.notes(load_task(TASK), found, random, nearest)), episode


def _probe(steps: int) -> dict[str, Any]:
    """The budget by which the speed of training is measured."""
    return {"steps": max(16 * steps, 6000), "seeds": 1, "deadline": 900, "checkpoints": 2, "random_starts": 0}


def _write(path: Path, content: Mapping[str, Any]) -> None:
    write(path, yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110))


def _numbers(score: Score) -> dict[str, float]:
    return {"robustness": float(f"{score.mean:.6g}"), "satisfied": float(f"{score.satisfaction:.6g}")}


# ------------------------------------------------------------------------------------------------------------ of a task


def _is_task(name: str) -> bool:
    return folders.is_path(name) or plugins.known("tasks", name) is not None


def _of_task(problem: Problem, home: Path) -> dict[str, Any]:
    """The content of the file of a task, without what helps by hand; its code is written beside it."""
    if problem.signals:
        raise UsageError(f"{problem.environment} is a task with its own signals; --signal is for an environment")
    task = load_task(problem.environment)
    content = task.file.model_dump(mode="json", exclude_defaults=True, exclude=_BY_HAND)
    content["time"] = "steps"
    if problem.formula is not None:
        seconds = (problem.time or task.file.time) == "seconds"
        formula = _formula(problem.formula, task.file.sampling_time if seconds else None, set(task.signals))
        _check_horizon(formula, task.file.steps, problem.environment)
        content["formula"], content["title"] = str(formula), f"{problem.formula} on {problem.environment}"
    if problem.terminated is not None:
        content["terminated"] = problem.terminated
    _write_code(task, home)
    return content


def _write_code(task: Task, home: Path) -> None:
    """The code of the folder: that of the task's own folder, or a class that inherits from the installed one."""
    kind = type(task.dynamics)
    if (place := folders.place_of(task.choice.name)) is not None:
        for path in place.glob("*.py"):
            write(home / path.name, path.read_text(encoding="utf-8"))
    elif not kind.__module__.endswith("."):  # a task that is a file alone has no class
        lines = (
            f'"""The dynamics of the task {task.name}."""\n\nfrom {kind.__module__} import {kind.__name__} as Base\n'
        )
        write(home / "system.py", f'{lines}\n\nclass Solved(Base):\n    """The same."""\n')


# ---------------------------------------------------------------------------------------------------- of an environment


def _of_environment(problem: Problem) -> dict[str, Any]:
    """The content of a task file on an environment of Gymnasium."""
    if problem.formula is None:
        raise UsageError(f"{problem.environment} is an environment, which has no formula of its own; give one")
    content = sketch(problem.environment, problem.keywords)
    entries = {name: (ends["low"], ends["high"]) for name, ends in content["signals"].items()}
    texts = {name: _expression(name, text, content["environment"]["names"]) for name, text in problem.signals.items()}
    if not {*_names(texts), *stl.signals(_parsed(problem.formula))} <= {*texts, *entries}:
        entries |= info_ends(problem.environment, problem.keywords)
    dt = content["sampling_time"] if problem.time == "seconds" else None
    formula = _formula(problem.formula, dt, {*texts, *entries})
    _check_horizon(formula, content["steps"], problem.environment)
    horizon = content["steps"] if unbounded(formula) is not None else max(1, stl.horizon(formula))
    hold = -(-horizon // _DECISIONS)
    steps = -(-horizon // hold) * hold
    used = [*texts, *(name for name in stl.signals(formula) if name not in texts)]
    return content | {
        "title": f"{problem.formula} on {problem.environment}",
        "formula": str(stl.resolve_end(formula, steps)),
        "time": "steps",
        "steps": steps,
        "hold": hold,
        "terminated": problem.terminated or ("hold" if _has_goals(formula) else "violated"),
        "signals": {name: _signal(name, texts.get(name), entries) for name in used},
    }


def _expression(name: str, text: str, names: Any) -> str:
    """The text with the names of entries in place of `obs[0]`, and of `obs[key][0]` in a Dict observation."""

    def entry(match: re.Match[str]) -> str:
        key, place = match.groups()
        several = names if isinstance(names, list) else names.get(key)
        index = int(key) if isinstance(names, list) and key.isdigit() else int(place or 0)
        if several is None or index >= len(several) or (isinstance(names, list) and not key.isdigit()):
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
            raise UsageError(f"signal {name}: {one_line(error)}") from error


def _signal(name: str, text: str | None, entries: Mapping[str, tuple[float, float]]) -> dict[str, Any]:
    """An entry of `signals`: the range of an expression follows from the ranges of the entries in it."""
    try:
        ends = stl.bounds(stl.parse(f"{text or name} >= 0"), entries, nodes=2000)
    except ValueError as error:
        raise UsageError(f"signal {name}: {one_line(error)}") from error
    if not np.isfinite([ends.low, ends.high]).all():
        raise UsageError(f"signal {name}: {text} is without ends where {entries}")
    low, high = (float(f"{end:.4g}") if abs(end) > _NOTHING else 0.0 for end in (ends.low, ends.high))
    if not low < high:
        raise UsageError(f"signal {name} is constant, {low:g}; a formula is over signals that change")
    return {"low": low, "high": high} | ({} if text is None or text == name else {"expression": text})


# --------------------------------------------------------------------------------------------------------- the formula


def _parsed(text: str, dt: float | None = None) -> stl.Formula:
    try:
        return stl.parse(text, dt=dt)
    except (ValueError, TypeError) as error:
        raise UsageError(f"formula: {one_line(error)}") from error


def _formula(text: str, dt: float | None, known: set[str]) -> stl.Formula:
    formula = _parsed(text, dt)
    for name in stl.signals(formula):
        if name not in known:
            raise UsageError(f"formula: no signal '{name}'{did_you_mean(name, known)}")
    return formula


def _check_horizon(formula: stl.Formula, steps: int, environment: str) -> None:
    if unbounded(formula) is None and (horizon := stl.horizon(formula)) > steps:
        raise UsageError(f"formula: it looks {horizon} steps ahead, and an episode of {environment} has {steps}")


def _has_goals(formula: stl.Formula) -> bool:
    """Whether an environment may end because something was reached: an operator asks for some time, not for all."""
    return any(isinstance(node, stl.Eventually | stl.Until) for node in walk(formula))
