"""The episodes of N copies: their time, the method's memory, and what was recorded of the signals."""

from __future__ import annotations

from typing import Any

import numpy as np

from stlbench.contract import Array, Integers, RewardMethod, Truth
from stlbench.rollout.early_ends import EarlyEnds
from stlbench.rollout.faults import check_inputs, check_memory, check_rewards, pay
from stlbench.rollout.observing import beside, scaled_times
from stlbench.rollout.wrapping.ends import verdicts
from stlbench.rollout.wrapping.scoring import Scoring


class Episodes:
    """N copies of an environment, each at its own step. `rows` are the numbers of the copies that are spoken of.

    A method that gives what its contract rules out is told by `rollout.faults.PluginFault`.
    """

    def __init__(self, scoring: Scoring, count: int) -> None:
        self._scoring = scoring
        self.steps, signals = scoring.specification.steps, len(scoring.specification.signals)
        self.t: Integers = np.zeros(count, dtype=np.int64)
        self._memory = np.zeros((count, scoring.method.memory_size))
        self._samples = np.full((count, self.steps + 1, signals), np.nan)
        self._times = np.minimum(scaled_times(self.steps), 1.0)

    @property
    def _method(self) -> RewardMethod:
        return self._scoring.method

    def start(self, rows: Integers, signals: Array) -> None:
        """Begin new episodes at the samples (r, k)."""
        self.t[rows] = 0
        self._samples[rows, 0] = signals
        if self._method.memory_size:
            memory = self._method.initial_memory(signals, self.t[rows])
            check_memory(self._method, memory, self.t[rows])
            self._memory[rows] = memory

    def arrive(self, rows: Integers, signals: Array, action: Array) -> Array:
        """One step, by actions (r, axes) to the samples (r, k): the rewards (r,)."""
        t, scoring = self.t[rows], self._scoring
        samples = np.stack([self._samples[rows, t], signals])
        rewards, self._memory[rows] = pay(self._method, samples, action, t, self._memory[rows])
        self._samples[rows, t + 1] = signals
        self.t[rows] = t + 1
        paid: Array = rewards[0] / scoring.scale
        return paid

    def left_out(self, row: int, action: Array) -> float:
        """What is paid at an early end beside its own step; `action` (1, axes) is the last one."""
        t, scoring = int(self.t[row]), self._scoring
        last, memory = self._samples[row, t], self._memory[[row]]
        ends = EarlyEnds(self._method, scoring.terminated)
        paid = ends.sum_left(last, action, t, memory, scoring.discount)
        check_rewards(self._method, np.array([[paid]]), 1, self.t[[row]])
        return paid / scoring.scale

    def verdicts(self, over: Truth) -> dict[str, Any]:
        """`robustness` and `satisfied` of all copies; 0 and False where no episode is over.

        Returns:
            Arrays (N,), under `interval` (N, 2), see `ends.verdicts`.
        """
        rows = np.flatnonzero(over)
        shape = (len(over), 2) if self._scoring.terminated == "interval" else (len(over),)
        found: dict[str, Any] = {"robustness": np.zeros(shape), "satisfied": np.zeros(shape, dtype=np.bool_)}
        if len(rows):
            traces, t = self._samples[rows], self.t[rows]
            for trace, last in zip(traces, t, strict=True):
                trace[last + 1 :] = trace[last]
            for name, values in verdicts(self._scoring, traces, t).items():
                found[name][rows] = values
        return found

    def observe(self) -> Array:
        """What is shown beside the observation: the time in [-1, 1], the method's inputs, (N, 1 + inputs)."""
        parts = beside(self._method, self._times, self.t, self._memory)
        for inputs in parts[1:]:
            check_inputs(self._method, inputs, self.t)
        return np.concatenate(parts, axis=1)
