"""Falsification: search the starts of a task for the one from which its formula is violated most."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stlbench import stl
from stlbench.errors import UsageError, did_you_mean
from stlbench.rollout.reasons import Loss, first_loss, last_step, reason
from stlbench.search.objective import Enough, Objective, Worst
from stlbench.search.optimisers import DEFAULT, OF_SEEDS, OPTIMISERS
from stlbench.search.space import Box, Seeds, space_of
from stlbench.search.subject import Subject, Unsearchable
from stlbench.study.cell import derive_seed

EVALUATIONS = 10_000


@dataclass(frozen=True)
class How:
    """By what rules is searched."""

    optimiser: str | None = None
    """One of `OPTIMISERS`; None for `DEFAULT`, and where starts are seeds for `OF_SEEDS`."""
    evaluations: int = EVALUATIONS
    """How many episodes are simulated at most."""
    least: bool = False
    """Go on after the first counterexample, for the least robustness."""
    seed: int = 0


@dataclass(frozen=True)
class Falsification:
    """What a search found: the least robust start, which is a counterexample where it violates the formula.

    A start that violates comes before one whose verdict is open, which comes before one that satisfies.
    """

    subject: Subject
    how: How
    """With the optimiser that searched."""
    evaluations: int
    """Episodes that were simulated."""
    first: int | None
    """Which of them, from 1, was the first with the verdict of the worst; None where all satisfied."""
    worst: Worst
    cpu_seconds: float

    @property
    def start(self) -> dict[str, float]:
        """The initial state by the names of its coordinates, or the seed."""
        return dict(zip(space_of(self.subject.task).names, self.worst.point.tolist(), strict=True))

    def start_text(self, digits: int) -> str:
        """The start in words, to so many significant digits; whole numbers, as seeds are, with all of theirs."""
        return ", ".join(f"{name} = {_number(value, digits)}" for name, value in self.start.items())

    @property
    def found(self) -> bool:
        """Whether there is a counterexample."""
        return self.worst.verdict == "violated"

    @property
    def open(self) -> bool:
        """Whether the episode from the least robust start ended early, and some continuations satisfy."""
        return self.worst.verdict == "open"

    @property
    def steps(self) -> int:
        """The last step of the least robust trace that was recorded: T, but after some early ends."""
        return last_step(self.worst.trace)

    @cached_property
    def witness(self) -> stl.Witness | None:
        """Which predicate, at which step, the least robustness comes from; None after an early end that decides it."""
        return reason(self.subject.task, self.worst.trace)

    @cached_property
    def loss(self) -> Loss | None:
        """The conjunct that the least robust trace lost first, by what was recorded of it; None where it lost none."""
        return first_loss(self.subject.task, self.worst.trace)

    @property
    def failed(self) -> str:
        """The conjunct that the least robustness comes from; after an early end the one that was lost, or the end."""
        if self.witness is not None:
            return str(self.witness.conjunct)
        if self.loss is not None:
            return self.loss.text
        return f"ended early, at step {self.steps}{', verdict open' if self.open else ''}"


def _number(value: float, digits: int) -> str:
    return f"{value:.0f}" if value == round(value) else f"{value:.{digits}g}"


def check(how: How) -> None:
    """Raises `UsageError` where these are no rules to search by."""
    if how.optimiser is not None and how.optimiser not in OPTIMISERS:
        raise UsageError(f"no optimiser '{how.optimiser}'{did_you_mean(how.optimiser, OPTIMISERS)}")
    if how.evaluations < 1:
        raise UsageError(f"a search needs at least one evaluation, got {how.evaluations}")


def falsify(
    subject: Subject, how: How | None = None, told: Callable[[int, float], None] = lambda count, least: None
) -> Falsification:
    """Search for a start from which the subject violates its task's formula.

    The search stops at the first start that is not sure to satisfy, or with `how.least` when all evaluations are used;
    an optimiser may also end before. After an early end the least robustness that is possible counts. A task with a
    single start takes one evaluation. The same rules give the same answer.

    Args:
        subject: what acts.
        how: by what rules.
        told: is called after each batch of episodes with their number and the least robustness so far.

    Raises:
        UsageError: no such optimiser, no evaluation.
        Unsearchable: the optimiser does not fit, what acts fails, or a robustness has no value.
    """
    began, space = time.process_time(), space_of(subject.task)
    how = _resolved(subject, how or How(), space)
    objective = Objective(subject, space, how.evaluations, how.least, told)
    _search(objective, how)
    if objective.failure is not None:
        raise objective.failure
    if objective.worst is None:
        assert isinstance(space, Box)
        rule = f"the condition '{space.region.where}' holds (almost) nowhere in the box"
        raise Unsearchable(f"{how.optimiser} met no start: {rule}")
    worst, spent = objective.worst, time.process_time() - began
    first = None if worst.verdict == "satisfied" else objective.firsts[worst.verdict]
    return Falsification(subject, how, objective.count, first, worst, spent)


def _resolved(subject: Subject, how: How, space: Box | Seeds) -> How:
    """With an optimiser that fits."""
    check(how)
    ordered = isinstance(space, Box)
    if not ordered and how.optimiser not in (None, OF_SEEDS):
        rule = f"its starts are seeds, which have no order to search by; --optimiser {OF_SEEDS} draws them"
        raise Unsearchable(f"{how.optimiser} cannot search task {subject.task.name}: {rule}")
    return replace(how, optimiser=how.optimiser or (DEFAULT if ordered else OF_SEEDS))


def _search(objective: Objective, how: How) -> None:
    with suppress(Enough):
        if objective.space.single:
            objective.of_points(objective.space.draw(np.random.default_rng(0), 1))
        else:
            assert how.optimiser is not None
            seed = derive_seed("falsify", objective.subject.task.choice.name, how.seed)
            OPTIMISERS[how.optimiser](objective, seed)
