"""Shared by agents: reports, costs, kinds of actions, libraries."""

from __future__ import annotations

import math
from collections.abc import Sequence
from importlib import import_module
from importlib.util import find_spec
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from stlbench.contract import ActionBox, ActionGrid, Actions, Cost, Unsuitable

if TYPE_CHECKING:
    from stlbench_agents.recipes import Learner


def report_rounds(rounds: int, checkpoints: int) -> set[int]:
    """The rounds, 1..rounds, after which a policy is reported: evenly spaced, the last among them."""
    return set(np.linspace(0, rounds, min(checkpoints, rounds) + 1)[1:].round().astype(int).tolist())


_UNIT = 40
"""Multiplications that take as long as the rest of an update for each unit of a layer: fitted to times of `dqn` and
`td3` with 16 to 6000 inputs (docs/performance-tables.md), whose ratios it meets within 30 %."""
_STORED = 2 * 4  # bytes of an input in replay: in single precision, before and after the transition


def cost_of(size: int, widths: Sequence[int], outputs: int, transitions: int) -> Cost:
    products = sum(before * after for before, after in pairwise([size, *widths, outputs]))
    return Cost(replay=transitions * size * _STORED, update=float(products + _UNIT * (sum(widths) + outputs)))


def grid_of(actions: Actions) -> ActionGrid:
    if not isinstance(actions, ActionGrid):
        raise Unsuitable(
            f"the task's actions {', '.join(actions.names)} are continuous, and this agent chooses from a grid; "
            "give each axis a count, or take an agent such as td3"
        )
    return actions


def box_of(actions: Actions) -> ActionBox:
    if not isinstance(actions, ActionBox):
        raise Unsuitable(
            f"the task's actions {', '.join(actions.names)} are a grid, and this agent's are continuous; "
            "take an agent such as dqn"
        )
    return actions


def refuse_other(own: Sequence[int], other: Sequence[int]) -> None:
    """Raises `Unsuitable` where a policy to start from has other inputs, or other hidden layers, than the network."""
    for what, ours, theirs in (("inputs", own[:1], other[:1]), ("hidden units", own[1:], other[1:])):
        if ours != theirs:
            numbers = [" and ".join(map(str, each)) for each in (theirs, ours)]
            raise Unsuitable(f"the policy to start from has {numbers[0]} {what}, and {numbers[1]} are needed")


def resumed_rate(recipe: Learner) -> float:
    """The first learning rate of a training from an earlier policy, between the first and the last of the recipe."""
    return math.sqrt(recipe.learning_rate * recipe.learning_rate_final)


def need_sb3() -> None:
    _need("torch", "PyTorch")
    _need("stable_baselines3", "Stable-Baselines3")


def need_onnx() -> Any:
    """The package `onnx`. Raises `Unsuitable` if it is not installed.

    It is no import of this module, so that a cell's key does not depend on whether it is installed.
    """
    _need("onnx", "ONNX", "onnx")
    import_module("onnx.numpy_helper")
    return import_module("onnx")


def _need(module: str, title: str, extra: str = "sb3") -> None:
    if find_spec(module) is None:
        raise Unsuitable(f'it needs {title}: pip install "stlbench-rl[{extra}]"')
