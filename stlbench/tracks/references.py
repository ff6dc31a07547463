"""The scores to compare a task's policies with: its controller, the baselines, the best known."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, TypeVar

from stlbench.contract import Intractable, Unsuitable
from stlbench.errors import UsageError
from stlbench.records.identity import Setting, Track
from stlbench.records.result import Score
from stlbench.registry import named_tasks
from stlbench.registry.choices import Choice, parse_choice
from stlbench.simulation import baselines
from stlbench.simulation.faults import Ask, Question, answers, ask_here
from stlbench.task import Task, build_method, load_task
from stlbench.task.build import Difference, Paid, equal_payments, payments
from stlbench.task.file import BestKnown
from stlbench.tracks.auto import for_every_method

_T = TypeVar("_T")

Likeness = Literal["=", "~"]  # how two methods pay the same: up to a constant, or up to a function of time
_Pair = tuple[Choice, Track, frozenset[str]]  # a task or an ablation of it, a track, and two methods, by their texts


@dataclass(frozen=True)
class References:
    """The reference scores of one task and of its ablations."""

    by_hand: Score | None = None  # the score of its controller, from the report's starts; None without one
    best_known: BestKnown | None = None  # from the task file; None if it says nothing
    own_agent: str | None = None
    """The agent that the task is trained with unless another is named; None where nobody knows."""
    hold: int | None = None  # steps for which the task holds an action; None where nobody knows
    at_random: Score | None = None  # the score of random actions, from the same starts; None if it is not known
    zero: Score | None = None  # the score of the action zero, from the same starts
    constant: Score | None = None  # the score of the best constant action, from the same starts
    alike: Mapping[_Pair, Likeness] = field(default_factory=dict)
    """Pairs of methods that pay the same (`equal_payments`)."""
    groups: Mapping[str, str] = field(default_factory=dict)
    """The system, template and so on of a task that a suite drew (`Suite.groups`)."""
    trivial: bool = False
    """Whether a constant action solves the task: it satisfies from as many starts as a policy that has learned it.
    Aggregates over tasks are also without such tasks."""

    def likeness(self, one: Setting, other: Setting) -> Likeness | None:
        """How the methods of two settings, which differ in nothing else, pay the same; None where they do not."""
        return self.alike.get((one.task, one.track, frozenset((str(one.method), str(other.method)))))


def about(task: Choice) -> Question[References]:
    return Question(known, (task,), (("tasks", task.name),), f"task {task}: it cannot be loaded")


def known(task: Choice) -> References:
    """The facts of a task that need no simulation."""
    loaded = load_task(task)
    return References(
        best_known=loaded.file.best_known,
        own_agent=loaded.own_agent,
        hold=loaded.file.hold,
        groups=named_tasks.groups(task.name),
    )


def by_hand(task: Choice) -> Question[Score | None]:
    return _of_task(baselines.score_controller, task, "its controller cannot be scored")


def at_random(task: Choice) -> Question[Score]:
    return _of_task(baselines.at_random, task, "actions at random cannot be scored")


def constant_actions(task: Choice) -> Question[baselines.Constants]:
    return _of_task(baselines.constants, task, "constant actions cannot be scored")


def _of_task(function: Callable[[Task], _T], task: Choice, problem: str) -> Question[_T]:
    return Question(_loaded, (function, task), (("tasks", task.name),), f"task {task}: {problem}")


def _loaded(function: Callable[[Task], _T], task: Choice) -> _T:
    return function(load_task(task))


def payment(task: Choice, track: Track, method: str) -> Question[Paid | None]:
    """Asks what a method pays; the answer is None if it does not fit, or pays by more than samples and time."""
    plugins = ("tasks", task.name), ("methods", parse_choice(method).name)
    return Question(_paid, (task, track, method), plugins, f"task {task}: method {method} cannot be asked what it pays")


def _paid(choice: Choice, track: Track, method: str) -> Paid | None:
    try:
        task = load_task(choice)
        return payments(build_method(for_every_method(task, task.own_agent, track), method))
    except (Intractable, Unsuitable, UsageError):
        return None


_OF_SCORES: tuple[Callable[[Choice], Question[Any]], ...] = (by_hand, at_random, constant_actions)


def references(settings: Iterable[Setting], ask: Ask = ask_here) -> dict[str, References]:
    """Name of a task -> the scores that its policies are compared with, in the order given.

    Tasks that cannot be loaded are left out, as results may come from another machine. A controller on a MuJoCo model
    takes seconds, and so do baselines that no task file states. A `PluginWarning` says why there is no answer.
    """
    by_task = dict[Choice, list[Setting]]()  # an ablation is compared with the scores of its whole task
    for setting in settings:
        by_task.setdefault(Choice(setting.task.name), []).append(setting)
    facts = answers(list(map(about, by_task)), ask)
    tasks = [task for task in by_task if about(task) in facts]
    scores: list[Question[Any]] = [question(task) for task in tasks for question in _OF_SCORES]
    answered = answers(scores, ask)
    return {task.name: _references(task, facts[about(task)], answered, _alike(by_task[task], ask)) for task in tasks}


def _references(
    task: Choice, facts: References, answered: Mapping[Any, Any], alike: Mapping[_Pair, Likeness]
) -> References:
    constants: baselines.Constants | None = answered.get(constant_actions(task))
    return replace(
        facts,
        by_hand=answered.get(by_hand(task)),
        at_random=answered.get(at_random(task)),
        zero=constants.zero if constants else None,
        constant=constants.best if constants else None,
        trivial=constants.trivial if constants else False,
        alike=alike,
    )


def differences(
    task: Choice, methods: Iterable[Choice | str], ask: Ask, track: Track = "shared"
) -> tuple[Difference, ...]:
    """The pairs of methods that pay the same on a task but for a function of time (`equal_payments`)."""
    questions = [payment(task, track, str(method)) for method in methods]
    return equal_payments({question.arguments[2]: paid for question, paid in answers(questions, ask).items()})


def _alike(settings: Iterable[Setting], ask: Ask) -> dict[_Pair, Likeness]:
    """Which methods pay the same, where several of them train a task or an ablation of it on one track."""
    kinds, alike = dict[tuple[Choice, Track], set[str]](), dict[_Pair, Likeness]()
    for setting in settings:
        kinds.setdefault((setting.task, setting.track), set()).add(str(setting.method))
    for (task, track), methods in kinds.items():
        for each in differences(task, sorted(methods), ask, track) if len(methods) > 1 else ():
            alike[task, track, frozenset((each.one, each.other))] = "~" if each.constant is None else "="
    return alike
