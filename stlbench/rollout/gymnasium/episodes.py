"""The episodes of N wrapped copies: their time, the method's memory, what was recorded of the signals, and the verdict.

It does for an environment that somebody else steps what `Simulator` and the referee do for a world.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Truth
from stlbench.errors import UsageError
from stlbench.rollout.early_ends import EarlyEnds, judge, without_end
from stlbench.rollout.faults import check_inputs, check_memory, check_rewards, pay
from stlbench.rollout.gymnasium.scoring import Scoring
from stlbench.rollout.observing import scaled_times, time_and_inputs

_CUT = (
    "an episode began anew after {} of {} steps, so that its formula was not judged; a TimeLimit belongs inside of "
    "stlbench.wrap, or give its limit as `steps`"
)


class Episodes:
    """N copies of an environment, each at its own step; `rows` are numbers of copies. Raises `PluginFault`."""

    def __init__(self, scoring: Scoring, count: int) -> None:
        self._scoring = scoring
        self.steps, signals = scoring.specification.steps, len(scoring.specification.signals)
        self.t: Integers = np.zeros(count, dtype=np.int64)
        self._memory = np.zeros((count, scoring.method.memory_size))
        self._samples = np.full((count, self.steps + 1, signals), np.nan)
        self._times = np.minimum(scaled_times(self.steps), 1.0)
        self._going, self._warned = np.zeros(count, dtype=np.bool_), False

    def start(self, rows: Integers, signals: Array) -> None:
        """Begin new episodes at the samples (r, k). Warns once of an episode that somebody cut before its end."""
        method = self._scoring.method
        if not self._warned and (cut := self.t[rows] * self._going[rows]).any():
            self._warned = True
            warnings.warn(_CUT.format(cut.max(), self.steps), stacklevel=3)
        self._going[rows] = True
        self.t[rows] = 0
        self._samples[rows, 0] = signals
        self._memory[rows] = check_memory(method, method.initial_memory(signals, self.t[rows]), self.t[rows])

    def step(self, going: Truth, signals: Array, action: Array, ended: Truth) -> tuple[Array, Truth, Truth]:
        """One step of the copies that are `going` (N,), to the samples (N, k); some have `ended` (N,).

        Returns the rewards (N,), 0 where a copy is not going, and which episodes are over and which are complete, (N,).
        """
        scoring, rewards, rows = self._scoring, np.zeros(len(going)), np.flatnonzero(going)
        t, scale = self.t[rows], scoring.method.scale if scoring.scaled else 1.0
        samples = np.stack([self._samples[rows, t], signals[rows]])
        paid, self._memory[rows] = pay(scoring.method, samples, action[rows], t, self._memory[rows])
        rewards[rows] = paid[0] / scale
        self._samples[rows, t + 1] = signals[rows]
        self.t[rows] = t + 1
        complete = going & (self.t == self.steps)
        over = ended | complete
        self._going &= ~over
        for row in np.flatnonzero(over).tolist():
            rewards[row] += self._left(row, action[[row]]) / scale
        return rewards, over, complete

    def _left(self, row: int, action: Array) -> float:
        """What the steps after an early end are paid, in the method's unit."""
        t, scoring = int(self.t[row]), self._scoring
        ends = EarlyEnds(scoring.method, scoring.terminated)
        paid = ends.sum_left(self._samples[row, t], action, t, self._memory[[row]], scoring.discount)
        check_rewards(scoring.method, np.array([[paid]]), 1, self.t[[row]])
        return paid

    def entries(self, signals: Array, own: Array, over: Truth) -> dict[str, Any]:
        """The entries of the info, of all copies; `own` (N,) are the environment's rewards.

        `robustness` and `satisfied` have shape (N,), under `interval` (N, 2): bounds of the robustness, and whether
        every and whether some continuation satisfies the formula. Where no episode is over they are what is known of
        all continuations, nothing: -inf and False, under `interval` (-inf, inf) and (False, True).
        """
        rows, scoring = np.flatnonzero(over), self._scoring
        interval, specification = scoring.terminated == "interval", scoring.specification
        shape = (len(over), 2) if interval else (len(over),)
        robustness, satisfied = np.full(shape, -np.inf), np.zeros(shape, dtype=np.bool_)
        if interval:
            robustness[:, 1], satisfied[:, 1] = np.inf, True
        if len(rows):
            t = self.t[rows]
            if scoring.terminated == "hold":
                traces = self._samples[rows[:, None], np.minimum(np.arange(self.steps + 1), t[:, None])]
            else:
                traces = without_end(self._samples[rows], t)
            try:
                verdicts = judge(specification.formula, traces, specification, scoring.terminated)
            except stl.UndefinedError as error:
                raise UsageError(f"formula: {error}") from error
            robustness[rows] = verdicts.robustness if interval else verdicts.robustness[:, 0]
            satisfied[rows] = verdicts.satisfied if interval else verdicts.satisfied[:, 0]
        verdict = {"robustness": robustness, "satisfied": satisfied}
        return {"signals": signals[:, None], "t": self.t, "env_reward": own, **verdict}

    def observe(self) -> Array:
        """What a policy sees after the numbers of the environment, (N, 1 + inputs)."""
        method = self._scoring.method
        parts = time_and_inputs(method, self._times, self.t, self._memory)
        for inputs in parts[1:]:
            check_inputs(method, inputs, self.t)
        return np.concatenate(parts, axis=1)
