"""A warm-up: what libraries load or compile at first use is not charged to a cell."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import numpy as np

from stlbench.contract import Agent, Array, CounterfactualEnvironment, Environment, Integers, Training, Transition

_DECISIONS = 1000  # the most decisions of all copies together. Agents begin to learn after some hundreds
_STEPPED = 2  # steps that the task itself makes. More would load nothing more, and a simulation can be dear


def rehearse(agent: Agent, training: Training, hold: int) -> None:
    """Train for a moment on copies that are stepped twice and then stand still; nothing is reported."""
    few, stage = min(training.steps, _DECISIONS * hold), _Stage()
    still = replace(training, make=lambda count: _Still(training.make(count), stage), steps=few, checkpoints=1)
    try:
        agent.train(replace(still, report=lambda policy, steps: None))
    finally:
        stage.is_open = False


class _Stage:
    """Whether the rehearsal goes on. Copies of its environments know it too."""

    is_open = True

    def __deepcopy__(self, memo: dict[int, Any]) -> _Stage:
        return self

    def check(self) -> None:
        if not self.is_open:
            raise RuntimeError("this environment is of the warm-up; a training has its own, of its own `make`")


class _Still:
    """An environment that repeats its last transition, as long as the rehearsal goes on."""

    def __init__(self, environment: Environment, stage: _Stage) -> None:
        stage.check()
        self._environment, self._left, self._stage = environment, _STEPPED, stage
        self.count, self.observation_size = environment.count, environment.observation_size
        self.actions, self.hold = environment.actions, environment.hold
        self.time_column, self.decisions = environment.time_column, environment.decisions
        self.counterfactuals = environment.counterfactuals if isinstance(environment, CounterfactualEnvironment) else 0

    def reset(self, alike: int = 1) -> Array:
        self._stage.check()
        return self._environment.reset(alike)

    def step(self, action: Integers | Array) -> Transition:
        self._stage.check()
        if self._left:
            self._left -= 1
            self._last = self._environment.step(action)
        return deepcopy(self._last)  # an agent may write into what it gets

    def counterfactual(self, generator: np.random.Generator) -> tuple[Array, Transition]:
        self._stage.check()
        assert isinstance(self._environment, CounterfactualEnvironment)
        return self._environment.counterfactual(generator)
