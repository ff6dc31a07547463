"""Where training episodes end early, as the task's `training.ends` say."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Truth
from stlbench.task.task import Task

__all__ = ["Endings"]


class Endings:
    """The ends of one task. False where it has none."""

    def __init__(self, task: Task) -> None:
        specification, t = task.specification, np.arange(task.file.steps + 1)
        self._ends: list[tuple[Callable[[Array], Truth], bool, Truth, float]] = []
        """A predicate, the verdict that ends the episode, the steps at which it does, and what is paid."""
        for ending in task.file.training.ends:
            if isinstance(ending.where, stl.Formula):
                anywhere = np.ones_like(t, dtype=np.bool_)
                self._ends.append((specification.holds(ending.where), True, anywhere, ending.reward))
                continue
            for term in specification.terms:
                if term.kind == "G":
                    active = (term.start <= t) & (t <= term.end)
                    self._ends.append((specification.holds(term.psi), False, active, ending.reward))

    def __bool__(self) -> bool:
        return bool(self._ends)

    def __call__(self, samples: Array, t: Integers) -> tuple[Truth, Array]:
        """Samples (N, h, k) whose last are at steps t (N,) -> whether it is over (N,), and what is paid then (N,)."""
        at = t[:, None] + np.arange(1 - samples.shape[1], 1)
        over, paid = np.zeros(len(samples), dtype=np.bool_), np.zeros(len(samples))
        for holds, verdict, active, reward in self._ends:
            now = active[at]
            if now.any():
                here = (now & (holds(samples) == verdict)).any(axis=1) & ~over
                over |= here
                paid[here] = reward
        return over, paid
