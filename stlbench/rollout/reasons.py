"""Why a recorded trace has its robustness, and what it lost first."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract import Array
from stlbench.rollout.early_ends import last_steps
from stlbench.task.task import Task

ENDED, OPEN = "ended early", "ended early, verdict open"  # in the place of the conjunct that failed first


class Loss(NamedTuple):
    """What a violating trace lost first."""

    conjunct: stl.Formula
    step: int  # from this sample on, no continuation of the trace could satisfy the conjunct any more

    @property
    def text(self) -> str:
        return f"{self.conjunct}, lost at step {self.step}"


def last_step(trace: Array) -> int:
    """The last step of a trace (T + 1, k) that was recorded: T, but after an early end."""
    return int(last_steps(trace[None])[0])


def reason(task: Task, trace: Array) -> stl.Witness | None:
    """The predicate and the step that decide the robustness of a trace (T + 1, k); None where an early end does."""
    if last_step(trace) < task.file.steps:
        return None
    return stl.witness(task.formula, trace, task.signals)


def first_loss(task: Task, trace: Array) -> Loss | None:
    """The conjunct of the task's formula that a trace (T + 1, k) lost first; None where it was never lost."""
    lived, parts = trace[: last_step(trace) + 1], conjuncts(task.formula)
    losses = [Loss(part, int(lost_at(part, lived[None], task.signals)[0])) for part in parts]
    first = min(losses, key=lambda loss: loss.step)
    return first if first.step < len(lived) else None


def first_failed(formula: stl.Formula, traces: Array, names: tuple[str, ...]) -> dict[str, int]:
    """How many of the traces, all violating, lost which conjunct first; an early end lost those that had lost none."""
    parts, steps = conjuncts(formula), last_steps(traces)
    counts = np.zeros(len(parts) + 1, dtype=np.int64)
    for last in np.unique(steps):
        lived = traces[steps == last, : last + 1]
        lost = np.stack([lost_at(part, lived, names) for part in parts])
        first = np.argmin(lost, axis=0)
        if last + 1 < traces.shape[1]:
            first[lost.min(axis=0) > last] = len(parts)
        counts += np.bincount(first, minlength=len(counts))
    return {name: count for name, count in zip([*map(str, parts), ENDED], counts.tolist(), strict=True) if count}


def conjuncts(formula: stl.Formula) -> list[stl.Formula]:
    """The formulas that a formula is the conjunction of; itself alone where it is none."""
    if isinstance(formula, stl.And):
        return [part for arg in formula.args for part in conjuncts(arg)]
    return [formula]


def lost_at(formula: stl.Formula, traces: Array, names: tuple[str, ...]) -> NDArray[np.int64]:
    """The first sample after which no continuation satisfies the formula; the trace's length where it is satisfied."""
    count, length = traces.shape[:2]
    monitor, lost = stl.BatchMonitor(formula, names, count), np.full(count, length)
    for t in range(length):
        possibly = monitor.update(traces[:, t]).possibly
        lost[~possibly & (lost == length)] = t
        if not possibly.any():
            break
    return lost
