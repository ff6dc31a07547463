"""Falsification: search the starts of a task for the one from which its formula is violated most."""

import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stlbench import stl
from stlbench.errors import UsageError, did_you_mean
from stlbench.search.actor import Actor, Box, Seeds, Unsearchable, space_of
from stlbench.search.optimisers import DEFAULT, OF_SEEDS, OPTIMISERS, Enough, Objective, Worst
from stlbench.simulation.verdicts import Loss, first_loss, last_step, reason
from stlbench.study.cell import derive_seed

EVALUATIONS = 10_000


@dataclass(frozen=True)
class How:
    optimiser: str | None = None  # one of `OPTIMISERS`; None for `DEFAULT`, or `OF_SEEDS` if starts are seeds
    evaluations: int = EVALUATIONS  # the most episodes that are simulated
    least: bool = False  # go on after the first counterexample, for the least robustness
    seed: int = 0


@dataclass(frozen=True)
class Falsification:
    """The result of a search: the worst start, a counterexample if it violates the formula.

    Verdicts from the worst: violated, open, satisfied. It is the least robust of the starts with the worst verdict.
    """

    actor: Actor
    how: How  # it has the name of the optimiser that was used
    evaluations: int  # episodes that were simulated
    first: int | None  # the first of them, from 1, with the verdict of the worst start; None if all satisfied
    worst: Worst
    cpu_seconds: float

    @property
    def start(self) -> dict[str, float]:
        """The initial state by the names of its coordinates, or the seed."""
        return dict(zip(space_of(self.actor.task).names, self.worst.point.tolist(), strict=True))

    def start_text(self, digits: int) -> str:
        """The start in words, to so many significant digits; whole numbers, such as seeds, with all digits."""
        values = self.start.items()
        return ", ".join(
            f"{name} = {value:{'.0f' if value == round(value) else f'.{digits}g'}}" for name, value in values
        )

    @property
    def found(self) -> bool:
        return self.worst.verdict == "violated"

    @property
    def open(self) -> bool:
        """Whether the worst episode ended early, and some continuations satisfy."""
        return self.worst.verdict == "open"

    @property
    def steps(self) -> int:
        """The last recorded step of the worst trace: T, or less after an early end."""
        return last_step(self.worst.trace)

    @cached_property
    def witness(self) -> stl.Witness | None:
        """The predicate and step that decide the robustness; None if an early end decides it."""
        return reason(self.actor.task, self.worst.trace)

    @cached_property
    def loss(self) -> Loss | None:
        """The conjunct that the recorded part of the worst trace lost first; None if it lost none."""
        return first_loss(self.actor.task, self.worst.trace)

    @property
    def failed(self) -> str:
        """The conjunct that decides the robustness; after an early end the lost conjunct, or the end."""
        if self.witness is not None:
            return str(self.witness.conjunct)
        if self.loss is not None:
            return self.loss.text
        return f"ended early, at step {self.steps}{', verdict open' if self.open else ''}"


def check(how: How) -> None:
    if how.optimiser is not None and how.optimiser not in OPTIMISERS:
        raise UsageError(f"no optimiser '{how.optimiser}'{did_you_mean(how.optimiser, OPTIMISERS)}")
    if how.evaluations < 1:
        raise UsageError(f"a search needs at least one evaluation, got {how.evaluations}")


def falsify(
    actor: Actor, how: How | None = None, progress: Callable[[int, float], None] = lambda count, least: None
) -> Falsification:
    """Search for a start from which the actor violates its task's formula.

    The search stops at the first start with a verdict other than satisfied, or with `how.least` when all evaluations
    are used; an optimiser may end before. After an early end the least possible robustness counts. The same options
    give the same result. `progress` is called after each batch with the evaluations and the least robustness so far.

    Raises:
        UsageError: no such optimiser, no evaluation.
        Unsearchable: the optimiser does not fit, the actor fails, or a robustness is undefined.
    """
    began, space = time.process_time(), space_of(actor.task)
    how = _resolved(actor, how or How(), space)
    objective = Objective(actor, space, how.evaluations, how.least, progress)
    _search(objective, how)
    if objective.failure is not None:
        raise objective.failure
    if objective.worst is None:
        assert isinstance(space, Box)
        rule = f"the condition '{space.region.where}' holds (almost) nowhere in the box"
        raise Unsearchable(f"{how.optimiser} met no start: {rule}")
    worst, spent = objective.worst, time.process_time() - began
    first = None if worst.verdict == "satisfied" else objective.firsts[worst.verdict]
    return Falsification(actor, how, objective.count, first, worst, spent)


def _resolved(actor: Actor, how: How, space: Box | Seeds) -> How:
    check(how)
    ordered = isinstance(space, Box)
    if not ordered and how.optimiser not in (None, OF_SEEDS):
        rule = f"its starts are seeds, which have no order to search by; --optimiser {OF_SEEDS} draws them"
        raise Unsearchable(f"{how.optimiser} cannot search task {actor.task.name}: {rule}")
    return replace(how, optimiser=how.optimiser or (DEFAULT if ordered else OF_SEEDS))


def _search(objective: Objective, how: How) -> None:
    with suppress(Enough):
        if objective.space.single:
            objective.of_points(objective.space.draw(np.random.default_rng(0), 1))
        else:
            assert how.optimiser is not None
            seed = derive_seed("falsify", objective.actor.task.choice.name, how.seed)
            OPTIMISERS[how.optimiser](objective, seed)
