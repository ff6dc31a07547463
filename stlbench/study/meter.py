"""What a training has spent: the steps of all its environments, and of copies of them, in one count."""

from __future__ import annotations

import math
import os
from typing import Any, NoReturn

from stlbench.contract import Array, Integers, RewardMethod, Transition
from stlbench.rollout.environment import BatchEnvironment
from stlbench.task import Task


class Meter:
    """Counts environment steps, against a budget once it has begun.

    Args:
        agent: for messages.
    """

    def __init__(self, agent: str) -> None:
        self.taken = 0
        self._agent, self._budget, self._process = agent, math.inf, os.getpid()

    def begin(self, budget: int) -> None:
        """What was taken until now does not count; from now on, this is the most that may be taken."""
        self.taken, self._budget = 0, budget

    def add(self, steps: int) -> None:
        """Count steps. Raises `RuntimeError` where they are beyond the budget, or in another process than this."""
        if os.getpid() != self._process:
            raise RuntimeError(f"agent {self._agent} steps an environment in another process, where nothing is counted")
        self.taken += steps
        if self.taken > self._budget:
            raise RuntimeError(f"agent {self._agent} took {self.taken} environment steps, its budget is {self._budget}")

    def check(self, reported: int) -> None:
        """Raises `RuntimeError` where a policy is said to be of more steps than were taken."""
        if not 0 <= reported <= self.taken:
            raise RuntimeError(
                f"agent {self._agent} reports a policy after {reported} environment steps, and had taken {self.taken}"
            )

    def check_trained(self) -> None:
        """Raises `RuntimeError` where no step was taken: such a policy was not trained."""
        if self.taken == 0:
            raise RuntimeError(
                f"agent {self._agent} returned a policy and took no environment step: an agent trains on environments "
                "of `training.make`, or says `trains = False`"
            )

    def __deepcopy__(self, memo: dict[int, Any]) -> Meter:
        return self  # the copy of an environment counts where the environment does

    def __reduce__(self) -> NoReturn:
        raise TypeError("an environment of a training cannot be sent elsewhere: its steps would not be counted")


class MeteredEnvironment(BatchEnvironment):
    """An environment whose steps are counted."""

    def __init__(self, task: Task, method: RewardMethod, count: int, seed: int, meter: Meter) -> None:
        super().__init__(task, method, count, seed)
        self._meter = meter

    def step(self, action: Integers | Array) -> Transition:
        """See `BatchEnvironment.step`."""
        self._meter.add(self.count * self.hold)
        return super().step(action)
