"""Calls of plugins outside of a cell. A plugin that fails costs its own answer alone."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from stlbench.contract import cause
from stlbench.errors import UsageError
from stlbench.records.identity import CellId
from stlbench.registry.plugins import PluginWarning
from stlbench.rollout.faults import PluginFault

_T = TypeVar("_T")
_Answer = TypeVar("_Answer", covariant=True)


@dataclass(frozen=True)
class Question(Generic[_Answer]):
    """A call that runs code of plugins. Another process can make it, as its parts can be pickled."""

    function: Callable[..., _Answer]  # importable by its name. It may raise whatever the plugins raise
    arguments: tuple[Any, ...]
    plugins: tuple[tuple[str, str], ...]
    """Kind and name of each plugin whose code runs, as in ("tasks", "hold-disc"); other code is
    ("functions", "module:function")."""
    failed: str  # what a user reads where there is no answer, before why: "task x: its controller cannot be scored"

    def answer(self) -> _Answer:
        return self.function(*self.arguments)


def plugins_of(cell: CellId) -> tuple[tuple[str, str], ...]:
    """The plugins of a question about the policy of a cell, for `Question.plugins`."""
    return ("tasks", cell.task.name), ("methods", cell.method.name), ("agents", cell.agent.name)


@dataclass(frozen=True)
class Unanswered:
    """In the place of an answer."""

    reason: str  # in one line: "no result after 120 s", "ValueError: no such luck"
    is_refusal: bool = False
    """The reason is a whole message of stlbench's own (`UsageError`), as where a plugin is not installed."""


class Ask(Protocol):
    """Answers questions, in their order."""

    def __call__(self, questions: Sequence[Question[_T]]) -> Sequence[_T | Unanswered]:
        """The answers."""


def ask_here(questions: Sequence[Question[_T]]) -> list[_T | Unanswered]:
    """All answers, in this process: one that hangs is waited for, and one that ends the process ends it."""
    return [answered_here(question) for question in questions]


def answered_here(question: Question[_T]) -> _T | Unanswered:
    try:
        return question.answer()
    except PluginFault as error:
        return Unanswered(str(error))
    except (UsageError, ImportError) as error:
        return Unanswered(str(error) or cause(error), is_refusal=True)
    except Exception as error:
        return Unanswered(cause(error))


def answers(questions: Sequence[Question[_T]], ask: Ask) -> dict[Question[_T], _T]:
    """The answers that there are. Where one fails and is no refusal, a `PluginWarning` says why."""
    answered = dict[Question[_T], _T]()
    for question, answer in zip(questions, ask(questions), strict=True):
        if not isinstance(answer, Unanswered):
            answered[question] = answer
        elif not answer.is_refusal:
            warnings.warn(f"{question.failed}: {answer.reason}", PluginWarning, stacklevel=3)
    return answered
