"""What agents share: reports, costs, kinds of actions, libraries, counterfactual transitions."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from typing import Any

import numpy as np

from stlbench.contract import (
    ActionBox,
    ActionGrid,
    Actions,
    Array,
    Cost,
    CounterfactualEnvironment,
    Environment,
    Integers,
    Transition,
    Unsuitable,
)


def report_rounds(rounds: int, checkpoints: int) -> set[int]:
    """The rounds, 1..rounds, after which a policy is reported: evenly spaced, the last among them."""
    return set(np.linspace(0, rounds, min(checkpoints, rounds) + 1)[1:].round().astype(int).tolist())


_UNIT = 40
"""Multiplications that take as long as what a unit of a layer takes beside its products, in an update: fitted to times
of `dqn` and `td3` with 16 to 6000 inputs (docs/performance-tables.md), whose ratios are met within 30 %."""
_STORED = 2 * 4
"""Bytes of an input in replay: in single precision, before and after the transition."""


def cost_of(size: int, widths: Sequence[int], outputs: int, transitions: int) -> Cost:
    """The cost of a network with `size` inputs, hidden layers and outputs, and of a replay of so many transitions."""
    products = sum(before * after for before, after in pairwise([size, *widths, outputs]))
    return Cost(replay=transitions * size * _STORED, update=float(products + _UNIT * (sum(widths) + outputs)))


def grid_of(actions: Actions) -> ActionGrid:
    """A task's actions, which have to be a grid. Raises `Unsuitable` where its actions are continuous."""
    if not isinstance(actions, ActionGrid):
        raise Unsuitable(
            f"the task's actions {', '.join(actions.names)} are continuous, and this agent chooses from a grid; "
            "give each axis a count, or take an agent such as td3"
        )
    return actions


def box_of(actions: Actions) -> ActionBox:
    """A task's actions, which have to be continuous. Raises `Unsuitable` where it has a grid."""
    if not isinstance(actions, ActionBox):
        raise Unsuitable(
            f"the task's actions {', '.join(actions.names)} are a grid, and this agent's are continuous; "
            "take an agent such as dqn"
        )
    return actions


def need_torch() -> None:
    """Raise `Unsuitable` where PyTorch is not installed. Imports nothing, as PyTorch takes seconds."""
    _need("torch", "PyTorch")


def need_sb3() -> None:
    """Raise `Unsuitable` where Stable-Baselines3, or the PyTorch that it builds on, is not installed."""
    need_torch()
    _need("stable_baselines3", "Stable-Baselines3")


def need_onnx() -> Any:
    """The package `onnx`. Raises `Unsuitable` where it is not installed.

    It writes policies that are trained, so by being there or not it must not change what a cell's key is made of: that
    sees what a source imports.
    """
    _need("onnx", "ONNX", "onnx")
    import_module("onnx.numpy_helper")
    return import_module("onnx")


def _need(module: str, title: str, extra: str = "sb3") -> None:
    if find_spec(module) is None:
        raise Unsuitable(f'it needs {title}: pip install "stlbench-rl[{extra}]"')


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
