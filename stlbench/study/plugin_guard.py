"""Plugins of others are asked in the guard that cells have: a process for each question, a deadline and a limit."""

import pickle
import sys
import tempfile
import warnings
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from stlbench.contract import Outcome, Work
from stlbench.errors import UsageError
from stlbench.registry import named_tasks, plugins
from stlbench.registry.choices import LOCAL, Choice
from stlbench.simulation.faults import Question, Unanswered, answered_here
from stlbench.study.scheduler import build_executor
from stlbench.task import Task, load_task
from stlbench.tracks.references import about, known

_T = TypeVar("_T")
EXECUTOR = LOCAL
DEADLINE = 120.0  # seconds for what takes milliseconds, or some seconds on a MuJoCo model
LONG = 3600.0  # seconds for a policy that acts from all starts of a report: what a cell has by default


@dataclass(frozen=True)
class _Call:
    question: Question[Any]
    folders: tuple[Path, ...]  # of its tasks that are folders


@dataclass(frozen=True)
class _Answer:
    answer: Any
    warnings: tuple[str, ...]


def ask(questions: Sequence[Question[_T]], deadline: float = DEADLINE) -> list[_T | Unanswered]:
    """The answers: where all plugins come with stlbench in this process, else in one that they cannot leave.

    One that hangs, ends its process or takes too much memory costs its own answer alone. What was not answered is not
    asked again by this process. A warning is given here as a `PluginWarning`.
    """
    answers = dict[int, _T | Unanswered]()
    for index, question in enumerate(questions):
        if all(_is_own(kind, name) for kind, name in question.plugins):
            answers[index] = answered_here(question)
        elif (before := _UNANSWERED.get(_identity(question))) is not None:
            answers[index] = before
    rest = [index for index in range(len(questions)) if index not in answers]
    answers |= dict(zip(rest, _in_guard([questions[index] for index in rest], deadline), strict=True))
    return [answers[index] for index in range(len(questions))]


def ask_one(question: Question[_T], deadline: float = LONG) -> _T:
    """The answer to a single question, on which all depends. Raises `UsageError` without an answer."""
    (answer,) = ask([question], deadline)
    if not isinstance(answer, Unanswered):
        return answer
    raise UsageError(answer.reason if answer.is_refusal else f"{question.failed}: {answer.reason}")


def load_guarded(choice: Choice | str) -> Task:
    """A task, for a reader of its file. A task of others is loaded here only if another process could load it.

    Raises `UsageError` as `load_task`; or if the task raises, hangs or ends its process while it is loaded.
    """
    chosen = named_tasks.task_of(choice)
    if not _is_own("tasks", chosen.name):
        question = about(Choice(chosen.name))
        if _identity(question) not in _LOADED:
            ask_one(question, DEADLINE)
    return load_task(chosen)


_UNANSWERED, _LOADED = dict[Any, Unanswered](), set[Any]()  # what was not answered, and which tasks could be loaded


def _identity(question: Question[Any]) -> Any:
    """The path and the folders say which code a name means."""
    return pickle.dumps(question), tuple(sys.path), _places(question)


def _places(question: Question[Any]) -> tuple[Path, ...]:
    collected = (named_tasks.place_of(name) for kind, name in question.plugins if kind == "tasks")
    return tuple(place for place in collected if place is not None)


def _is_own(kind: str, name: str) -> bool:
    try:
        return kind in plugins.KINDS and plugins.find(kind, name).is_own
    except UsageError:  # it is not installed, which is said where it is asked
        return True


def _in_guard(questions: Sequence[Question[_T]], deadline: float) -> list[_T | Unanswered]:
    if not questions:
        return []
    collected = dict[int, Any]()
    with tempfile.TemporaryDirectory(prefix="stlbench-questions-") as folder:
        work = Work(_answered, _ready, partial(_log, Path(folder)))
        items = [_Call(question, _places(question)) for question in questions]
        with closing(build_executor(EXECUTOR).run(work, items, [deadline] * len(items))) as outcomes:
            for outcome in outcomes:
                collected[outcome.index] = _taken(outcome)
    answers = [collected[index] for index in range(len(questions))]
    for question, answer in zip(questions, answers, strict=True):
        if isinstance(answer, Unanswered):
            _UNANSWERED[_identity(question)] = answer
        elif question.function is known:
            _LOADED.add(_identity(question))
    return answers


def _log(folder: Path, call: _Call) -> Path:
    """The prints of a plugin are not for a reader of a report, or of its JSON."""
    return folder / str(id(call))


def _taken(outcome: Outcome) -> Any:
    if outcome.status != "done" or not isinstance(outcome.value, _Answer):
        return Unanswered(outcome.reason or "no answer")
    for text in outcome.value.warnings:
        warnings.warn(text, plugins.PluginWarning, stacklevel=2)
    return outcome.value.answer


def _ready() -> None:
    """To find this function, a process has imported what answers need."""


def _answered(call: _Call) -> _Answer:
    for folder in call.folders:
        named_tasks.know(folder)  # this process may be another than the one in which it was named
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default", plugins.PluginWarning)
        answer = answered_here(call.question)
    messages = (str(each.message) for each in caught if issubclass(each.category, plugins.PluginWarning))
    return _Answer(answer, tuple(dict.fromkeys(messages)))
