"""The rules of training episodes: where they end early, and the model of them that a planner is given."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from stlbench import stl
from stlbench.contract import Array, End, Integers, Model, RewardMethod, Truth
from stlbench.task.task import Task

_STARTS = 256


def model_of(task: Task, method: RewardMethod) -> Model:
    """The dynamics and the reward as pure functions, under the rules by which training episodes go on."""
    file, generator = task.file, np.random.default_rng(0)
    return Model(
        system=task.system,
        method=method,
        formula=task.formula,
        actions=task.actions,
        steps=file.steps,
        hold=file.hold,
        cuts=file.training.cuts,
        ends=ends_of(task, method),
        starts=task.starts.of_training(generator, _STARTS),
    )


def ends_of(task: Task, method: RewardMethod) -> tuple[End, ...]:
    """The ends of a task in the order in which they count; one for each term where the task names violations.

    All pay the method's floor. A payout in the task file would favour some of the methods, as their units differ.
    """
    return tuple(_ends(task, method.floor / method.scale))


def _ends(task: Task, reward: float) -> Iterator[End]:
    specification, t = task.specification, np.arange(task.file.steps + 1)
    for ending in task.file.training.ends:
        if isinstance(ending.where, stl.Formula):
            yield End(specification.holds(ending.where), np.ones_like(t, dtype=np.bool_), reward)
            continue
        for term in specification.terms:
            if term.kind == "G":
                active = (term.start <= t) & (t <= term.end)
                yield End(specification.holds(stl.Not(term.psi)), active, reward)


def first_end(ends: Sequence[End], samples: Array, t: Integers) -> tuple[Truth, Array]:
    """Samples (N, h, k) whose last are at steps t (N,) -> whether it is over (N,), and what is paid then (N,)."""
    at = t[:, None] + np.arange(1 - samples.shape[1], 1)
    over, paid = np.zeros(len(samples), dtype=np.bool_), np.zeros(len(samples))
    for end in ends:
        now = end.active[at]
        if now.any():
            here = (now & end.over(samples)).any(axis=1) & ~over
            over |= here
            paid[here] = end.reward
    return over, paid
