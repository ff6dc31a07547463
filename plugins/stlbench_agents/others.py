"""What a learner stores beside the transitions of an environment: the same with other memories of the method."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from stlbench.contract import Array, CounterfactualEnvironment, Environment, Integers, Transition


class Others:
    """The counterfactual transitions of an environment: none, where it or the recipe has none."""

    def __init__(self, environment: Environment, times: int, seed: int) -> None:
        """Args: `times` so many of each transition; `seed` of a generator that nothing else draws from."""
        has = isinstance(environment, CounterfactualEnvironment) and environment.counterfactuals
        self._environment, self._times = environment, times if has else 0
        self._generator = np.random.default_rng([seed, 1, 1])
        self.copies = environment.count * (1 + self._times)

    def beside(
        self, observation: Array, action: Integers, transition: Transition
    ) -> tuple[Array, Integers, Transition]:
        """A lock-step of N copies (N, D), (N,), with the counterfactual ones after it, in `copies` rows each."""
        if not (self._times and isinstance(self._environment, CounterfactualEnvironment)):
            return observation, action, transition
        others = [self._environment.counterfactual(self._generator) for _ in range(self._times)]
        seen = np.concatenate([observation, *(before for before, _ in others)])
        return seen, np.tile(action, 1 + self._times), _joined([transition, *(after for _, after in others)])


def _joined(transitions: Iterable[Transition]) -> Transition:
    columns: Iterable[Any] = zip(*transitions, strict=True)
    return Transition(*map(np.concatenate, columns))
