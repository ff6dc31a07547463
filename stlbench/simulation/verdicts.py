"""The meaning of a verdict: that of an episode which the environment ends early, and why a trace has its robustness.

Unless the last sample stays (`hold`), traces have NaN after it.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract import Array, Integers, RewardMethod, Specification, Truth
from stlbench.stl.recorded.evaluator import value_range
from stlbench.task.file import EarlyEnd
from stlbench.task.task import Task


class Verdicts(NamedTuple):
    """For n traces. The two ends of an interval are equal wherever a trace is complete."""

    robustness: Array  # (n, 2): the least and the greatest over all continuations
    satisfied: Truth  # (n, 2): whether all continuations satisfy, and whether some do


def judge(formula: stl.Formula, traces: Array, specification: Specification, terminated: EarlyEnd) -> Verdicts:
    """The verdicts on traces (n, T + 1, k), NaN after an early end, by a formula over the specification's signals.

    An early end leaves an interval of what is possible within the ranges (`interval`). Under `violated` the formula
    counts as violated: its robustness is the least that is possible within the ranges, and at most 0. A recorded sample
    may make sure of less.
    """
    early: Truth = np.zeros(len(traces), dtype=np.bool_)
    if terminated != "hold":
        early |= np.isnan(traces[:, -1]).any(axis=1)
    names = specification.signals
    robustness, satisfied = np.empty((len(traces), 2)), np.empty((len(traces), 2), dtype=np.bool_)
    complete = traces[~early] if early.any() else traces  # without a copy of what can be large
    robustness[~early] = stl.robustness(formula, complete, names)[:, None]
    satisfied[~early] = stl.satisfied(formula, complete, names)[:, None]
    if not early.any():
        return Verdicts(robustness, satisfied)
    least, greatest = value_range(formula, specification.range)
    rows = np.flatnonzero(early)
    t = last_steps(traces[rows])
    for last in np.unique(t):
        alike = rows[t == last]
        known = traces[alike, : last + 1]
        low, high = stl.robustness_bounds(formula, known, names)
        # the ranges narrow what is open; but recorded samples may have left them, and these count more
        robustness[alike, 0] = np.minimum(np.maximum(low, least), high)
        robustness[alike, 1] = np.maximum(np.minimum(high, greatest), low)
        satisfied[alike] = np.stack(stl.satisfaction_bounds(formula, known, names), axis=-1)
        if terminated == "violated":
            robustness[alike], satisfied[alike] = np.minimum(high, min(least, 0.0))[:, None], False
    return Verdicts(robustness, satisfied)


def last_steps(traces: Array) -> Integers:
    """The last row of each of traces (N, T + 1, k) that is not NaN in all signals, (N,): T, but after early ends."""
    missing: Truth = np.logical_and.reduce(np.isnan(traces), axis=2)
    last: Integers = traces.shape[1] - 1 - np.argmin(missing[:, ::-1], axis=1)
    return last


@dataclass(frozen=True)
class EarlyEnds:
    """The pay of a method for an episode that its environment ends before step T."""

    method: RewardMethod
    terminated: EarlyEnd
    """`hold` pays what the method pays while the last sample stays. `violated` pays its floor for each step that is
    left, or once if the method can end. `interval` pays nothing."""

    @property
    def _once_and_each(self) -> tuple[float, float]:
        """The pay at the end, and at each step that is left, unless the last sample stays."""
        floor = self.method.floor if self.terminated == "violated" else 0.0
        return (floor, 0.0) if self.method.can_end else (0.0, floor)

    def sum_left(self, last: Array, action: Array, t: int, memory: Array, discount: float = 1.0) -> float:
        """The pay of the steps after step t, 1..T, in one sum, discounted, in the method's unit; 0 at the last step.

        `last` (k,) is the sample at t, `action` (1, axes) the last one, `memory` (1, m) that at t.
        """
        left = self.method.specification.steps - t
        if left == 0:
            return 0.0
        weights = discount ** np.arange(1.0, left + 1)
        if self.terminated != "hold":
            once, each = self._once_and_each
            return float(once * weights[0] + each * weights.sum())
        samples = np.tile(last, (left + 1, 1, 1))
        rewards, _ = self.method.along(samples, action, np.array([t]), memory)
        return float(weights @ rewards[:, 0])

    def standing_still(self, reward: Array, before: Truth, now: Truth, t: Integers, hold: int) -> Array:
        """Rewards (N,) of one decision to steps t (N,), where a copy that has ended stands still up to step T.

        Over the steps that are left they add up to `sum_left` without a discount. `before` (N,) are the copies that had
        ended or were over before the decision, `now` (N,) those that the environment has ended after it.
        """
        if self.terminated == "hold":
            return reward
        once, each = self._once_and_each
        stops: Truth = now & ~before & (t < self.method.specification.steps)
        return np.where(before, each, reward) + np.where(stops, once / hold, 0.0)  # a reward is a mean of `hold` steps


def without_end(traces: Array, last: Integers) -> Array:
    """Traces (n, T + 1, k) of which nothing counts after the samples at steps `last` (n,): NaN, in place."""
    traces[np.arange(traces.shape[1]) > last[:, None]] = np.nan
    return traces


ENDED, OPEN = "ended early", "ended early, verdict open"  # in the place of the conjunct that failed first


class Loss(NamedTuple):
    """The conjunct that a violating trace lost first."""

    conjunct: stl.Formula
    step: int  # no continuation of the trace could satisfy the conjunct from this sample on

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
