"""Why a recorded trace has its robustness, and what it lost first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract import Array
from stlbench.rollout.referee import conjuncts, lost_at
from stlbench.task.task import Task


class Loss(NamedTuple):
    """What a violating trace lost first."""

    conjunct: stl.Formula
    step: int
    """From this sample on, no continuation of the trace could satisfy the conjunct any more."""

    @property
    def text(self) -> str:
        """In words."""
        return f"{self.conjunct}, lost at step {self.step}"


def lasted(trace: Array) -> int:
    """The last step of a trace (T + 1, k) that was recorded: T, but after some early ends."""
    return int(np.flatnonzero(~np.isnan(trace).any(axis=1))[-1])


def reason(task: Task, trace: Array) -> stl.Witness | None:
    """Which predicate, at which step, the robustness of a trace (T + 1, k) comes from.

    None where an early end left the trace without its rest, which then decides.
    """
    if lasted(trace) < task.file.steps:
        return None
    return stl.witness(task.formula, trace, task.signals)


def first_loss(task: Task, trace: Array) -> Loss | None:
    """The conjunct of the task's formula that a trace (T + 1, k) lost first; None where it was never lost."""
    lived, parts = trace[: lasted(trace) + 1], conjuncts(task.formula)
    losses = [Loss(part, int(lost_at(part, lived[None], task.signals)[0])) for part in parts]
    first = min(losses, key=lambda loss: loss.step)
    return first if first.step < len(lived) else None
