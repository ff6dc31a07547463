"""What methods of others pay, asked in the guard that cells have: a process for each, with a deadline and a limit."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from stlbench.contract import Work
from stlbench.errors import UsageError
from stlbench.registry import folders, plugins
from stlbench.registry.choices import parse_choice
from stlbench.rollout.standards import Question, ask_here, paid
from stlbench.study.run import build_executor
from stlbench.task.equal_rewards import Paid

__all__ = ["ask"]

EXECUTOR = "local"
DEADLINE = 120.0
"""Seconds for a method; one takes milliseconds."""


@dataclass(frozen=True)
class _Asked:
    """What another process is told."""

    question: Question
    folder: Path | None
    """Of the task, where it is one."""


def ask(questions: Sequence[Question]) -> list[Paid | str | None]:
    """The answers: of methods that come with stlbench in this process, of others in one that they cannot leave.

    See `standards.Ask`. One that hangs, ends its process or takes too much memory costs its own answer alone.
    """
    answers = dict[int, Paid | str | None]()
    others = [index for index, question in enumerate(questions) if not _is_own(question.method)]
    for index, question in enumerate(questions):
        if index not in others:
            (answers[index],) = ask_here([question])
    if others:
        items = [_Asked(questions[index], folders.place_of(questions[index].task.name)) for index in others]
        executor = build_executor(EXECUTOR)
        with closing(executor.run(Work(_paid, _ready), items, [DEADLINE] * len(items))) as outcomes:
            for outcome in outcomes:
                is_answer = outcome.status == "done" and isinstance(outcome.value, Paid | None)
                answers[others[outcome.index]] = outcome.value if is_answer else outcome.reason or "no answer"
    return [answers[index] for index in range(len(questions))]


def _is_own(method: str) -> bool:
    try:
        return plugins.find("methods", parse_choice(method).name).distribution == plugins.OWN
    except UsageError:  # it is not installed, which is said where it is asked
        return True


def _ready() -> None:
    """To find this function, a process has imported what answers need."""


def _paid(asked: _Asked) -> Paid | None:
    if asked.folder is not None:
        folders.know(asked.folder)  # this process may be another than the one in which it was named
    return paid(asked.question)
