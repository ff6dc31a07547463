"""The referee: rolls policies out from fixed starts and scores the recorded traces with the task's formula.

It is the only place where a robustness that is reported comes from. No reward, and nothing of a method or an agent,
enters a score: a method is there only to give the policy the inputs that it was trained with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract import Array, Integers, Policy, RewardMethod
from stlbench.result import MAIN, Score
from stlbench.rollout.environment import Simulator
from stlbench.task import starts
from stlbench.task.task import Task

__all__ = ["Assessment", "Evaluation", "Referee", "follow", "record", "score", "start_states"]


def start_states(task: Task) -> tuple[Array, Array]:
    """The states (starts, n) behind the main score of the report, and those on which checkpoints are selected.

    The two sets share no state.
    """
    return starts.grid_apart(task.file.initial, task.file.starts, task.system.initial_states)


def record(
    task: Task, method: RewardMethod, policy: Policy, states: Array, visited: list[Array] | None = None
) -> Array:
    """The traces (N, T + 1, k) of the signals when `policy` acts from `states` (N, n) to the end of the episode.

    The states at each decision and at the end, (N, n) each, are appended to `visited`, where it is given.
    """
    return follow(task, method, lambda simulator: policy.act(simulator.observe()), states, visited)


def follow(
    task: Task,
    method: RewardMethod,
    act: Callable[[Simulator], Integers | Array],
    states: Array,
    visited: list[Array] | None = None,
) -> Array:
    """As `record`, where `act` says at each decision what to do: indices (N,) of the grid, or vectors (N, axes)."""
    simulator = Simulator(task, method, rewarded=False)
    simulator.reset(states)
    trace = np.empty((len(states), task.file.steps + 1, len(task.signals)))
    trace[:, 0] = simulator.signals
    if visited is not None:
        visited.append(simulator.state)
    for t in range(0, task.file.steps, simulator.hold):
        trace[:, t + 1 : t + 1 + simulator.hold] = simulator.advance(act(simulator)).samples
        if visited is not None:
            visited.append(simulator.state)
    return trace


def score(formula: stl.Formula, traces: Array, names: tuple[str, ...]) -> Score:
    """Robustness and Boolean satisfaction of a formula on traces (N, T + 1, k) at t = 0."""
    satisfied = stl.satisfied(formula, traces, names)
    return Score(
        robustness=tuple(float(value) for value in stl.robustness(formula, traces, names)),
        satisfied=tuple(bool(value) for value in satisfied),
        first_failed=_first_failed(formula, traces[~satisfied], names),
    )


def _first_failed(formula: stl.Formula, traces: Array, names: tuple[str, ...]) -> dict[str, int]:
    """How many of the traces, all violating, lost which conjunct first."""
    if not len(traces):
        return {}
    parts = _conjuncts(formula)
    lost = np.stack([lost_at(part, traces, names) for part in parts])
    counts = np.bincount(np.argmin(lost, axis=0), minlength=len(parts))
    return {str(part): int(count) for part, count in zip(parts, counts, strict=True) if count}


def _conjuncts(formula: stl.Formula) -> list[stl.Formula]:
    if isinstance(formula, stl.And):
        return [part for arg in formula.args for part in _conjuncts(arg)]
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


@dataclass(frozen=True)
class Evaluation:
    """One protocol, ready: the formula in steps and the states that policies start from."""

    formula: stl.Formula
    states: Array


class Assessment(NamedTuple):
    """What the referee says of one policy."""

    scores: dict[str, Score]
    """Protocol -> score."""
    traces: Array
    """(N, T + 1, k): the traces behind the main score."""
    states: Array
    """(N, decisions + 1, n): the states behind them, at each decision and at the end."""


class Referee:
    """Scores the policies of one cell: checkpoints for selection, then the report.

    Args:
        task: the task; its protocols and its grid of initial states.
        method: what gives the policy its inputs.
    """

    def __init__(self, task: Task, method: RewardMethod) -> None:
        self.task, self.method = task, method
        file = task.file
        reported, self._selection = start_states(task)
        self._protocols = {MAIN: Evaluation(task.formula, reported)}
        for name, protocol in file.protocols.items():
            formula = protocol.formula or task.formula
            region = protocol.initial or file.initial
            self._protocols[name] = Evaluation(
                formula, task.system.initial_states(starts.grid(region, protocol.starts))
            )

    def select(self, policy: Policy) -> tuple[float, float]:
        """Satisfaction and mean robustness of the task's formula from the starts kept for selection.

        These share no state with the report's.
        """
        traces = record(self.task, self.method, policy, self._selection)
        formula, names = self.task.formula, self.task.signals
        satisfied, robustness = stl.satisfied(formula, traces, names), stl.robustness(formula, traces, names)
        return float(satisfied.mean()), float(robustness.mean())

    def assess(self, policy: Policy) -> Assessment:
        """Every protocol's score, from the report's starts."""
        scores, traces, visited = {}, {}, list[Array]()
        for name, evaluation in self._protocols.items():
            states = visited if name == MAIN else None
            traces[name] = record(self.task, self.method, policy, evaluation.states, states)
            scores[name] = score(evaluation.formula, traces[name], self.task.signals)
        return Assessment(scores, traces[MAIN], np.stack(visited, axis=1))
