"""What the policies of a task are compared with: its controller, the baselines, the best known."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from stlbench.contract import Intractable, Unsuitable
from stlbench.errors import UsageError
from stlbench.records.identity import Setting, Track
from stlbench.records.result import Score
from stlbench.registry.choices import Choice, parse_choice
from stlbench.rollout import baselines, controller
from stlbench.rollout.questions import Ask, answers, ask_here
from stlbench.task import build_method, load_task
from stlbench.task.equal_rewards import Difference, Paid, equal_payments, payments
from stlbench.task.file import BestKnown

Likeness = Literal["=", "~"]
"""How two methods pay the same: up to a constant, or up to a function of time."""
_Pair = tuple[Choice, Track, frozenset[str]]
"""A task or an ablation of it, a track, and two methods, by their texts."""


@dataclass(frozen=True)
class Standard:
    """Of one task; an ablation has that of the task that it is one of."""

    by_hand: Score | None = None
    """The score of its controller, from the report's starts; None without one."""
    best_known: BestKnown | None = None
    """As the task file says; None where it says nothing."""
    own_agent: str | None = None
    """The agent that the task is trained with unless another is named; None where nobody knows."""
    at_random: Score | None = None
    """What actions at random get from the same starts; None where nobody knows."""
    zero: Score | None = None
    """What the action zero gets from them."""
    constant: Score | None = None
    """What the best constant action gets from them."""
    alike: Mapping[_Pair, Likeness] = field(default_factory=dict)
    """Of the methods that were asked for, those that pay the same (`equal_payments`)."""
    trivial: bool = False
    """Whether a constant action solves the task: it satisfies from as many starts as a policy that has learned it.
    Aggregates over tasks are also without such tasks."""

    def likeness(self, one: Setting, other: Setting) -> Likeness | None:
        """How the methods of two settings, which differ in nothing else, pay the same; None where they do not."""
        return self.alike.get((one.task, one.track, frozenset((str(one.method), str(other.method)))))


@dataclass(frozen=True)
class Known:
    """What a task says of itself."""

    best_known: BestKnown | None
    own_agent: str


@dataclass(frozen=True)
class _OfTask:
    task: Choice

    @property
    def plugins(self) -> tuple[tuple[str, str], ...]:
        """See `Question`."""
        return (("tasks", self.task.name),)


@dataclass(frozen=True)
class About(_OfTask):
    """What does a task say of itself? It is loaded for that."""

    @property
    def failed(self) -> str:
        """See `Question`."""
        return f"task {self.task}: it cannot be loaded"

    def answer(self) -> Known:
        """See `Question`."""
        task = load_task(self.task)
        return Known(task.file.best_known, task.own_agent)


@dataclass(frozen=True)
class ByHand(_OfTask):
    """What does a task's controller get? None of a task without one."""

    @property
    def failed(self) -> str:
        """See `Question`."""
        return f"task {self.task}: its controller cannot be scored"

    def answer(self) -> Score | None:
        """See `Question`."""
        return controller.score(load_task(self.task))


@dataclass(frozen=True)
class AtRandom(_OfTask):
    """What do actions at random get on a task?"""

    @property
    def failed(self) -> str:
        """See `Question`."""
        return f"task {self.task}: actions at random cannot be scored"

    def answer(self) -> Score:
        """See `Question`."""
        return baselines.at_random(load_task(self.task))


@dataclass(frozen=True)
class ConstantActions(_OfTask):
    """What do actions get on a task that are taken all the time?"""

    @property
    def failed(self) -> str:
        """See `Question`."""
        return f"task {self.task}: constant actions cannot be scored"

    def answer(self) -> baselines.Constants:
        """See `Question`."""
        return baselines.constants(load_task(self.task))


@dataclass(frozen=True)
class Pays:
    """What does a method pay on a task, or on an ablation of one?

    None where that is no function of samples and time alone, or where the method does not fit.
    """

    task: Choice
    track: Track
    method: str
    """The text of a choice."""

    @property
    def plugins(self) -> tuple[tuple[str, str], ...]:
        """See `Question`."""
        return ("tasks", self.task.name), ("methods", parse_choice(self.method).name)

    @property
    def failed(self) -> str:
        """See `Question`."""
        return f"task {self.task}: method {self.method} cannot be asked what it pays"

    def answer(self) -> Paid | None:
        """See `Question`."""
        try:
            task = load_task(self.task)
            if self.track == "plain":
                task = replace(task, file=task.file.plain())
            return payments(build_method(task, self.method))
        except (Intractable, Unsuitable, UsageError):
            return None


def standards(settings: Iterable[Setting], ask: Ask = ask_here) -> dict[str, Standard]:
    """Name of a task -> what its policies are compared with, each once, in the order given.

    Left out are tasks that are not installed or cannot be loaded: results may come from another machine. It takes some
    seconds for a controller on a MuJoCo model, which is simulated, and for baselines that no task file states. All that
    plugins do for it is asked by `ask`; of one that gives no answer a `PluginWarning` says why.
    """
    by_task = dict[Choice, list[Setting]]()
    for setting in settings:
        by_task.setdefault(Choice(setting.task.name), []).append(setting)
    abouts = answers(list(map(About, by_task)), ask)
    tasks = [about.task for about in abouts]
    questions = [question for task in tasks for question in _of_task(task, by_task[task])]
    found = answers(questions, ask)
    alike = _alike({of: paid for of, paid in found.items() if isinstance(of, Pays)})
    return {about.task.name: _standard(about.task, known, found, alike) for about, known in abouts.items()}


def _standard(
    task: Choice, known: Known, found: Mapping[Any, Any], alike: Mapping[str, Mapping[_Pair, Likeness]]
) -> Standard:
    constants: baselines.Constants | None = found.get(ConstantActions(task))
    return Standard(
        by_hand=found.get(ByHand(task)),
        best_known=known.best_known,
        own_agent=known.own_agent,
        at_random=found.get(AtRandom(task)),
        zero=constants.zero if constants else None,
        constant=constants.best if constants else None,
        trivial=constants.trivial if constants else False,
        alike=alike.get(task.name, {}),
    )


def differences(task: Choice, methods: Iterable[Choice | str], ask: Ask) -> tuple[Difference, ...]:
    """Those pairs of methods that pay the same on a task but for a function of time (`equal_payments`).

    Of one that gives no answer a `PluginWarning` says why.
    """
    questions = [Pays(task, "shared", str(method)) for method in methods]
    return equal_payments({question.method: paid for question, paid in answers(questions, ask).items()})


def _of_task(task: Choice, members: Iterable[Setting]) -> list[ByHand | AtRandom | ConstantActions | Pays]:
    return [ByHand(task), AtRandom(task), ConstantActions(task), *_questions(members)]


def _questions(members: Iterable[Setting]) -> list[Pays]:
    """Those about each method with which a task or an ablation is trained on a track, beside others."""
    kinds = dict[tuple[Choice, Track], set[str]]()
    for setting in members:
        kinds.setdefault((setting.task, setting.track), set()).add(str(setting.method))
    several = {kind: methods for kind, methods in kinds.items() if len(methods) > 1}
    return [Pays(*kind, method) for kind, methods in several.items() for method in sorted(methods)]


def _alike(paid: Mapping[Pays, Paid | None]) -> dict[str, dict[_Pair, Likeness]]:
    """By the name of the task."""
    by_kind = dict[tuple[Choice, Track], dict[str, Paid | None]]()
    for question, answer in paid.items():
        by_kind.setdefault((question.task, question.track), {})[question.method] = answer
    found = dict[str, dict[_Pair, Likeness]]()
    for (task, track), payments_of in by_kind.items():
        for each in equal_payments(payments_of):
            found.setdefault(task.name, {})[task, track, frozenset((each.one, each.other))] = _likeness(each)
    return found


def _likeness(difference: Difference) -> Likeness:
    return "~" if difference.constant is None else "="
