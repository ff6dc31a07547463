"""The folder of a solve: the task file that it writes for a problem, and what the first tries say of it."""

import json
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field

from stlbench import stl
from stlbench.contract import Array, GymTask
from stlbench.errors import UsageError, one_line
from stlbench.records.result import Score
from stlbench.records.result_files import TRAININGS, inside, write
from stlbench.registry import named_tasks
from stlbench.registry.choices import Choice
from stlbench.schedules.schedule import around, schedules
from stlbench.simulation import baselines
from stlbench.simulation.baselines import in_pieces
from stlbench.solver import tries
from stlbench.solver.problem import Problem, code_beside, content_of, given_to_code
from stlbench.task import Task, load_task
from stlbench.task.entry import Finite, Positive
from stlbench.task.reading import dump_yaml, file_of, load_yaml
from stlbench.tracks.auto import regions, scheduled

TASK = Choice("task")
"""The folder of the task file, and so the task's name."""
UNSCHEDULED = Choice(TASK.name, (("without", "schedule"),))
_ASKED, _FILE, WITNESS = "solve.json", "task.yaml", "witness.json"
WITNESSED, WIDE = "witness", "wide"
"""Schedules in the task file: around witnesses, and with wider windows at a share of the greatest pace."""
_WIDE_PACE = 0.7
"""The windows are then so wide that a goal can be reached in 70 % of the time that there is at most."""
_WITNESSES = 4
"""Starts of training from which one is searched, at most."""
_FIRST_LOOK_SHARE = 0.02
"""The share of the time for each of the first tries: scores, and constant actions."""
_PLAY_SECONDS = 5.0
"""Seconds for which a slow environment may be played at least, before anything is known of its signals."""
_SEARCH_SHARE, _SEARCH_SECONDS = 0.01, 15.0
"""The share of the time for the search for a witness, and the most seconds for it."""
_GENERATION_RATIO = 3.0
"""No witness is searched where one generation would take so many times the seconds of a search."""
_PROBE_EPISODES = 100
"""The most episodes of the training that measures the speed."""
_CONSTANT_STARTS, _CONSTANT_ACTIONS = 4, 50
"""Starts from which constant actions are compared at most, and about how many are."""


@dataclass(frozen=True)
class Workspace:
    """A problem whose task file is written."""

    folder: Path
    episode_seconds: float
    """The time to simulate an episode that does not end early, without training."""
    copy_seconds: float
    """The time to make a copy of the simulation."""

    @property
    def task(self) -> Task:
        """As the file has it now."""
        return load_task(TASK)

    @property
    def state(self) -> dict[str, Any]:
        """The content of `solve.json`: the problem, the minutes, and the methods that race."""
        return _state(self.folder)

    @property
    def notes(self) -> tuple[str, ...]:
        """Facts for the user, in a line each, whatever a policy reaches."""
        return tuple(map(one_line, self.state["notes"]))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Further notes, which a policy refutes that satisfies."""
        return tuple(map(one_line, self.state["doubts"]))

    def remember(self, **facts: Any) -> None:
        """Write facts into `solve.json`."""
        write(self.folder / _ASKED, json.dumps(self.state | facts, indent=1))

    def budget(self, name: str, **numbers: float | None) -> None:
        """Write a budget into the task file."""
        self._change(budgets=self._content["budgets"] | {name: numbers})

    @property
    def choices(self) -> tuple[Choice, ...]:
        """The task with another schedule, if it has one, and the task."""
        return (*(Choice(TASK.name, (("schedule", name),)) for name in self.task.file.schedules), TASK)

    @property
    def unscheduled(self) -> tuple[Choice, ...]:
        """The task with its formula as it is, where it has a schedule, and the task."""
        return (TASK,) if scheduled(self.task) is None else (UNSCHEDULED, TASK)

    @property
    def course(self) -> Array | None:
        """The actions of the witness (decisions, axes); None where none was found."""
        if not (path := self.folder / WITNESS).is_file():
            return None
        try:
            actions = _Witness.model_validate_json(path.read_bytes()).actions
            task = self.task
            decisions = task.file.decisions
            course = np.array(actions, dtype=np.float64).reshape(len(actions), len(task.actions.names))
        except (OSError, ValueError) as error:
            raise UsageError(f"{path} is not as `stlbench solve` writes it; name another folder") from error
        return course[in_pieces(decisions, len(course))]

    def search(self, seconds: float) -> str | None:
        """Search for witnesses, keep the first, and write another schedule; what to say of it, once."""
        if self.state.get("searched"):
            return None
        task, given = self.task, min(_SEARCH_SECONDS, _SEARCH_SHARE * seconds)
        found = list[tries.Nearest]()
        if tries.COPIES * self.episode_seconds <= _GENERATION_RATIO * given:
            starts = task.starts.of_training(np.random.default_rng(0), _WITNESSES)
            clock = time.perf_counter()
            for begun in starts:
                found.append(tries.search(task, given, begun, found[-1] if found else None))
                if not found[-1].satisfies or time.perf_counter() - clock > given:
                    break
            if found[0].satisfies:
                facts = {name: getattr(found[0], name) for name in ("robustness", "episodes", "actions")}
                write(self.folder / WITNESS, json.dumps({"start": starts[0].tolist()} | facts))
        traces = [each.trace for each in found if each.satisfies]
        self._follow(np.array(traces).reshape(len(traces), task.file.steps + 1, len(task.signals)))
        note = tries.of_search(found[0] if found else None)
        warning = tries.of_course(task, found[0]) if traces else None
        kind = "doubts" if found and not traces else "notes"
        self.remember(searched=True, **{kind: [*self.state[kind], note, *filter(None, [warning])]})
        return note if warning is None else f"{note}; {warning}"

    def _follow(self, traces: Array) -> None:
        """Write another schedule, unless the task has none: around witnesses (n, T + 1, k), else with wider windows."""
        task, file, known = self.task, self.task.file, regions(self.task)
        if (own := scheduled(task)) is None:
            return
        found = around(file.formula, known, file.hold, file.steps, traces)
        name = WIDE if found is None else WITNESSED
        found = found or schedules(file.formula, known, file.hold, file.steps, _WIDE_PACE)[0]
        if found.formula != own:
            self._change(schedules={name: str(found.formula)})

    def begin(self, minutes: float) -> None:
        """Forget methods and budgets that were chosen for another time."""
        if self.state.get("minutes") != minutes:
            self._change(budgets={"probe": self._content["budgets"]["probe"]})
            self.remember(minutes=minutes, methods=None, chosen=None)

    def drop_trainings(self) -> None:
        """Remove the files from which trainings go on: they are large, and none will."""
        for place in self.folder.glob(f"*/{TRAININGS}"):
            shutil.rmtree(inside(place, self.folder))

    def _change(self, **entries: Any) -> None:
        """Write entries into the task file."""
        _write(self._file, self._content | entries)

    @property
    def _file(self) -> Path:
        return self.folder / TASK.name / _FILE

    @property
    def _content(self) -> dict[str, Any]:
        content: dict[str, Any] = load_yaml(self._file.read_text(encoding="utf-8"), str(self._file))
        return content


def workspace_of(
    problem: Problem, folder: Path, minutes: float = 10.0, say: Callable[[str], None] = lambda text: None
) -> Workspace:
    """Write the task file of a problem, or go on with the one that is there. It takes a small part of the minutes.

    Raises:
        UsageError: there is no such environment or task, the formula does not fit it, or a signal is constant. The
            environment ends at once, or is too slow for the minutes. The folder has another problem, code that is not
            this problem's, or links.
    """
    asked, home = folder / _ASKED, folder / TASK.name
    for path in folder.iterdir() if folder.is_dir() else ():
        inside(path, folder)  # all that is written, before anything is trained
    if asked.is_file():
        state = _state(folder)
        if state["problem"] != problem.facts:
            raise UsageError(f"{folder} has another problem, {_shown(state['problem'])}; name another folder")
        _refuse_other_code(problem, home)
        named_tasks.know(home, instead=True)
        return Workspace(folder, state["episode_seconds"], state["copy_seconds"])
    if home.exists():
        raise UsageError(
            f"{home} is there, and `stlbench solve` has not finished it; remove it, or name another folder"
        )
    try:
        state = {"problem": problem.facts} | _prepared(problem, home, 60 * minutes, say)
    except BaseException:  # ctrl-C too: the next call would refuse half a folder
        shutil.rmtree(home, ignore_errors=True)
        raise
    write(asked, json.dumps(state, indent=1))
    return Workspace(folder, state["episode_seconds"], state["copy_seconds"])


def is_of(problem: Problem, folder: Path) -> bool:
    """Whether `solve` worked on this problem in this folder."""
    return (folder / _ASKED).is_file() and bool(_state(folder)["problem"] == problem.facts)


class _State(BaseModel):
    """The content of `solve.json`."""

    problem: dict[str, Any]
    notes: tuple[str, ...]
    doubts: tuple[str, ...] = ()
    episode_seconds: Positive
    copy_seconds: Annotated[Finite, Field(ge=0)] = 0.0  # earlier programs did not measure it
    repeatable: bool = True
    searched: bool = False
    minutes: float | None = None
    methods: tuple[str, ...] | None = None
    chosen: str | None = None


class _Witness(BaseModel):
    """The actions of `witness.json`, each held for an equal part of the episode."""

    actions: Annotated[tuple[tuple[Finite, ...], ...], Field(min_length=1)]


def _state(folder: Path) -> dict[str, Any]:
    path = folder / _ASKED
    try:
        return _State.model_validate_json(path.read_bytes()).model_dump()
    except (OSError, ValueError) as error:
        raise UsageError(f"{path} is not as `stlbench solve` writes it; name another folder") from error


def _refuse_other_code(problem: Problem, home: Path) -> None:
    """Raise `UsageError` if the folder of the task has anything that runs and that this problem would not write there.

    The folder may come from a stranger who knows the problem. Files that Python compiled there are deleted, as they may
    have another source.
    """
    for path in home.glob("*"):
        inside(path, home)
    file = file_of(home)
    shutil.rmtree(home / "__pycache__", ignore_errors=True)
    code = code_beside(problem)
    for name in sorted({path.name for path in home.iterdir()} | code.keys() - {_FILE}):
        if name != _FILE and not ((home / name).is_file() and (home / name).read_bytes() == code.get(name)):
            raise UsageError(f"{home / name} is not as this solve writes it; remove {home.parent}, or name another")
    given = given_to_code(file)
    for name, value in given_to_code(problem).items():
        if given[name] != value:
            got = one_line(f"{name} should be {value!r}, as the problem has it, got {given[name]!r}")
            raise UsageError(f"{home / _FILE}: {got}")


def _shown(problem: Mapping[str, Any]) -> str:
    return f"{problem['environment']} {problem['formula'] or ''}".strip()


def _prepared(problem: Problem, home: Path, seconds: float, say: Callable[[str], None]) -> dict[str, Any]:
    """Write the folder of the task; what `solve.json` says of it."""
    content = content_of(problem, max(_PLAY_SECONDS, _FIRST_LOOK_SHARE * seconds))
    content["budgets"] = {"probe": _probe(content["steps"])}
    _write(home / _FILE, content)
    for name, code in code_beside(problem).items():
        write(home / name, code)
    named_tasks.know(home, instead=True)
    task = load_task(TASK)
    copy, episode = tries.simulation_seconds(task)
    tries.check_speed(task, episode, seconds / 60, say)
    tries.try_at_random(task)
    if isinstance(task.dynamics, GymTask):  # each copy is stepped by itself, which may take long
        content["starts"] = int(np.clip(_FIRST_LOOK_SHARE * seconds / episode, tries.FEWEST, task.file.starts))
        _write(home / _FILE, content)
        task = load_task(TASK)
    starts = int(np.clip(_FIRST_LOOK_SHARE * seconds / (_CONSTANT_ACTIONS * episode), 1, _CONSTANT_STARTS))
    try:
        found, random = baselines.constants(task, starts), baselines.at_random(task)
    except stl.UndefinedError as error:
        raise UsageError(f"the formula has no value in an episode: {one_line(error)}") from error
    content["baselines"] = {
        "zero": _numbers(found.zero),
        "constant": _numbers(found.best) | {"action": list(found.action)},
        "random": _numbers(random),
    }
    _write(home / _FILE, content)
    task = load_task(TASK)
    repeatable = tries.is_repeatable(task)
    notes, doubts = [*tries.notes(task, found, random, repeatable)], [*tries.doubts(task)]
    if task.file.notes:  # the seconds of a step
        notes.insert(0, task.file.notes)
    measured = {"episode_seconds": episode, "copy_seconds": copy, "repeatable": repeatable}
    return {"notes": notes, "doubts": doubts} | measured


def _probe(steps: int) -> dict[str, Any]:
    """The budget by which the speed of training is measured. It suffices for an easy problem."""
    return {
        "steps": max(_PROBE_EPISODES * steps, 6000),
        "seeds": 1,
        "deadline": 900,
        "checkpoints": 2,
        "random_starts": 0,
    }


def _write(path: Path, content: Mapping[str, Any]) -> None:
    write(path, dump_yaml(content, default_flow_style=None, width=110))


def _numbers(score: Score) -> dict[str, float]:
    return {"robustness": float(f"{score.mean:.6g}"), "satisfied": float(f"{score.satisfaction:.6g}")}
