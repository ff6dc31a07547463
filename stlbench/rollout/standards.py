"""What the policies of a task are compared with: its controller, actions at random, the best that is possible."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from stlbench.contract import Intractable, Unsuitable, cause
from stlbench.errors import UsageError
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.result import Score, Setting, Track
from stlbench.rollout import controller
from stlbench.task import build_method, load_task
from stlbench.task.equal_rewards import Difference, Paid, equal_payments, payments
from stlbench.task.file import BestPossible

__all__ = ["Ask", "Likeness", "Question", "Standard", "ask_here", "paid", "standards"]

Likeness = Literal["=", "~"]
"""How two methods pay the same: up to a constant, or up to a function of time."""
_Pair = tuple[Choice, Track, frozenset[str]]
"""A task or an ablation of it, a track, and two methods, by their texts."""


@dataclass(frozen=True)
class Standard:
    """Of one task; an ablation has that of the task that it is one of."""

    by_hand: Score | None = None
    """The score of its controller, from the report's starts; None without one."""
    best_possible: BestPossible | None = None
    """As the task file says; None where it says nothing."""
    own_agent: str | None = None
    """The agent that the task is trained with unless another is named; None where nobody knows."""
    at_random: Score | None = None
    """What actions at random get from the same starts; None where nobody knows."""
    alike: Mapping[_Pair, Likeness] = field(default_factory=dict)
    """Of the methods that were asked for, those that pay the same (`equal_payments`)."""

    def likeness(self, one: Setting, other: Setting) -> Likeness | None:
        """How the methods of two settings, which differ in nothing else, pay the same; None where they do not."""
        return self.alike.get((one.task, one.track, frozenset((str(one.method), str(other.method)))))


@dataclass(frozen=True)
class Question:
    """What does a method pay on a task, or on an ablation of one?"""

    task: Choice
    track: Track
    method: str
    """The text of a choice."""


Ask = Callable[[Sequence[Question]], Sequence[Paid | str | None]]
"""Answers questions: what is paid; None where that is no function of samples and time alone, or where the method does
not fit; a text where it could not be asked, why."""


def paid(question: Question) -> Paid | None:
    """The answer, in this process. Raises whatever the method raises."""
    try:
        task = load_task(question.task)
        if question.track == "plain":
            task = replace(task, file=task.file.plain())
        return payments(build_method(task, question.method))
    except (Intractable, Unsuitable, UsageError):
        return None


def ask_here(questions: Sequence[Question]) -> list[Paid | str | None]:
    """All answers, in this process."""
    return [_paid_or_said(question) for question in questions]


def _paid_or_said(question: Question) -> Paid | str | None:
    try:
        return paid(question)
    except Exception as error:
        return cause(error)


def standards(settings: Iterable[Setting], ask: Ask = ask_here) -> dict[str, Standard]:
    """Name of a task -> what its policies are compared with, each once, in the order given.

    Left out are tasks that are not installed or cannot be loaded: results may come from another machine. Some seconds
    for a task on a MuJoCo model, which is simulated. What a method pays is asked by `ask`; of one that could not be
    asked a `PluginWarning` says why.
    """
    by_task, found = dict[str, list[Setting]](), dict[str, Standard]()
    for setting in settings:
        by_task.setdefault(setting.task.name, []).append(setting)
    for name in by_task:
        try:
            task = load_task(Choice(name))
        except (UsageError, ImportError):
            continue
        except Exception as error:
            controller.warn(name, error)
            continue
        by_hand, at_random = controller.score(task), controller.score_at_random(task)
        found[name] = Standard(by_hand, task.file.best_possible, task.own_agent, at_random)
    alike = _alike([question for name in found for question in _questions(by_task[name])], ask)
    return {name: replace(standard, alike=alike.get(name, {})) for name, standard in found.items()}


def _questions(members: Iterable[Setting]) -> list[Question]:
    """Those about each method with which a task or an ablation is trained on a track, beside others."""
    kinds = dict[tuple[Choice, Track], set[str]]()
    for setting in members:
        kinds.setdefault((setting.task, setting.track), set()).add(str(setting.method))
    several = {kind: methods for kind, methods in kinds.items() if len(methods) > 1}
    return [Question(*kind, method) for kind, methods in several.items() for method in sorted(methods)]


def _alike(questions: Sequence[Question], ask: Ask) -> dict[str, dict[_Pair, Likeness]]:
    """By the name of the task."""
    answers = dict[tuple[Choice, Track], dict[str, Paid | None]]()
    for question, answer in zip(questions, ask(questions), strict=True):
        if isinstance(answer, str):
            said = f"task {question.task}: method {question.method} cannot be asked what it pays: {answer}"
            warnings.warn(said, plugins.PluginWarning, stacklevel=3)
            continue
        answers.setdefault((question.task, question.track), {})[question.method] = answer
    found = dict[str, dict[_Pair, Likeness]]()
    for (task, track), payments_of in answers.items():
        for each in equal_payments(payments_of):
            found.setdefault(task.name, {})[task, track, frozenset((each.one, each.other))] = _likeness(each)
    return found


def _likeness(difference: Difference) -> Likeness:
    return "~" if difference.constant is None else "="
