"""Falsification: search the starts of a task for the one from which its formula is violated most."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from stlbench import stl
from stlbench.contract import Array
from stlbench.errors import UsageError, did_you_mean
from stlbench.search.objective import Enough, Objective, Worst
from stlbench.search.optimisers import DEFAULT, OPTIMISERS
from stlbench.search.space import Space
from stlbench.search.subject import Subject
from stlbench.study.plan import derive_seed

__all__ = ["Falsification", "How", "check", "falsify"]

EVALUATIONS = 10_000


@dataclass(frozen=True)
class How:
    """By what rules is searched."""

    optimiser: str = DEFAULT
    """One of `OPTIMISERS`."""
    evaluations: int = EVALUATIONS
    """How many episodes are simulated at most."""
    least: bool = False
    """Go on after the first counterexample, for the least robustness."""
    seed: int = 0


@dataclass(frozen=True)
class Falsification:
    """What a search found: the least robust start, which is a counterexample where it violates the formula."""

    subject: Subject
    how: How
    evaluations: int
    """Episodes that were simulated."""
    first: int | None
    """Which of them, from 1, was the first to violate the formula; None where none did."""
    worst: Worst
    cpu_seconds: float

    @property
    def start(self) -> dict[str, float]:
        """The initial state by the names of its coordinates."""
        names = Space(self.subject.task).names
        return dict(zip(names, self.worst.point.tolist(), strict=True))

    @property
    def found(self) -> bool:
        """Whether there is a counterexample."""
        return not self.worst.satisfied

    @property
    def witness(self) -> stl.Witness:
        """Which predicate, at which step, the least robustness comes from."""
        task = self.subject.task
        return stl.witness(task.formula, self.worst.trace, task.signals)


def check(how: How) -> None:
    """Raises `UsageError` where these are no rules to search by."""
    if how.optimiser not in OPTIMISERS:
        raise UsageError(f"no optimiser '{how.optimiser}'{did_you_mean(how.optimiser, OPTIMISERS)}")
    if how.evaluations < 1:
        raise UsageError(f"a search needs at least one evaluation, got {how.evaluations}")


def falsify(
    subject: Subject, how: How | None = None, told: Callable[[int, float], None] = lambda count, least: None
) -> Falsification:
    """Search for a start from which the subject violates its task's formula.

    The search stops at the first counterexample, or with `how.least` when all evaluations are used; an optimiser may
    also end before. A task with a single start takes one evaluation. The same rules give the same answer.

    Args:
        subject: what acts.
        how: by what rules.
        told: is called after each batch of episodes with their number and the least robustness so far.

    Raises:
        UsageError: no such optimiser, no evaluation, or a robustness that has no value.
    """
    how = how or How()
    check(how)
    began, space = time.process_time(), Space(subject.task)
    objective = Objective(subject, space, how.evaluations, how.least, told)
    with suppress(Enough):
        if space.size == 0:
            objective.of_points(_only(space))
        else:
            OPTIMISERS[how.optimiser](objective, derive_seed("falsify", subject.task.choice.name, how.seed))
    if objective.failure is not None:
        raise objective.failure
    if objective.worst is None:
        condition = space.region.where
        raise UsageError(f"{how.optimiser} met no start: the condition '{condition}' holds (almost) nowhere in the box")
    spent = time.process_time() - began
    return Falsification(subject, how, objective.count, objective.first, objective.worst, spent)


def _only(space: Space) -> Array:
    """The task's single start, (1, n)."""
    return space.draw(np.random.default_rng(0), 1)
