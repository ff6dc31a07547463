"""A smooth robustness and its derivatives: minima and maxima are log-sum-exp (Pant, Abbas and Mangharam, CCTA 2017)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch

from stlbench import stl
from stlbench.contract import Array
from stlbench.stl.language.syntax import Connective, Prefix
from stlbench.task import Task

_DIFFERENCE, _NEVER = 1e-6, 1e3
"""The step of differences; and more than any margin, for an until whose left side is asked at no sample yet."""


def slope(task: Task, states: Array, k: float) -> Array:
    """The derivatives (N, T + 1, n) of the smooth robustness by the states of courses (N, T + 1, n)."""
    flat, margins = states.reshape(-1, states.shape[2]), _margins(task, states)
    signals = task.system.signals(flat)
    _smooth(task.formula, margins, k, False)[:, 0].sum().backward()  # type: ignore[no-untyped-call]
    by_signals = np.zeros((len(flat), 1, signals.shape[1]))
    for each, values in margins.items():
        assert values.grad is not None
        by_signals += values.grad.numpy().reshape(-1, 1, 1) * derivatives(stl.margin(each, task.signals), signals)
    by_state: Array = (by_signals @ derivatives(task.system.signals, flat)).reshape(states.shape)
    return by_state


def value_of(task: Task, states: Array, k: float) -> Array:
    """The smooth robustness (N,) of courses (N, T + 1, n): the minimum of m values is up to log(m) / k too low.

    Raises `ValueError` for a formula with operators that the suite does not draw.
    """
    with torch.no_grad():
        return _smooth(task.formula, _margins(task, states), k, False)[:, 0].numpy()


def _margins(task: Task, states: Array) -> dict[stl.Formula, torch.Tensor]:
    """Predicate -> its margins (N, T + 1), which know their gradient."""
    signals = task.system.signals(states.reshape(-1, states.shape[2]))
    margins = {each: stl.margin(each, task.signals)(signals) for each in dict.fromkeys(_predicates(task.formula))}
    return {each: torch.tensor(own.reshape(states.shape[:2]), requires_grad=True) for each, own in margins.items()}


def derivatives(function: Callable[[Array], Array], at: Array) -> Array:
    """The derivatives (M, values, n) of a function of points (M, n), by central differences."""
    n = at.shape[1]
    moved = np.concatenate([np.eye(n), -np.eye(n)]) * _DIFFERENCE
    values = function((at[:, None] + moved).reshape(-1, n)).reshape(len(at), 2, n, -1)
    slopes: Array = (values[:, 0] - values[:, 1]) / (2 * _DIFFERENCE)
    return slopes.transpose(0, 2, 1)


def _predicates(formula: stl.Formula) -> list[stl.Formula]:
    if isinstance(formula, stl.Predicate):
        return [formula]
    return [each for operand in formula.operands for each in _predicates(operand)]  # type: ignore[arg-type]


def _smooth(formula: stl.Formula, margins: dict[stl.Formula, torch.Tensor], k: float, negated: bool) -> torch.Tensor:
    """The smooth robustness (N, L) of a part, or of its negation, at the first L steps: as many as the trace allows."""

    def least(values: torch.Tensor, dim: int) -> torch.Tensor:
        return -torch.logsumexp(-k * values, dim) / k

    def most(values: torch.Tensor, dim: int) -> torch.Tensor:
        return torch.logsumexp(k * values, dim) / k

    match formula:
        case stl.Predicate():
            return -margins[formula] if negated else margins[formula]
        case Connective():
            parts = [_smooth(each, margins, k, sign != negated) for each, sign in formula.signed]
            length = min(each.shape[1] for each in parts)
            fold = least if formula.least != negated else most
            return fold(torch.stack([each[:, :length] for each in parts]), 0)
        case Prefix(a=a, b=b, arg=arg, past=False):
            fold = least if formula.least != negated else most
            return fold(_smooth(arg, margins, k, negated)[:, a:].unfold(1, b - a + 1, 1), 2)
        case stl.Until(a=0, b=b, left=left, right=right) if not negated:  # at step 0 alone
            before = -torch.logcumsumexp(-k * _smooth(left, margins, k, False)[:, :b], 1) / k
            before = torch.cat([torch.full_like(before[:, :1], _NEVER), before], 1)
            return most(least(torch.stack([before, _smooth(right, margins, k, False)[:, : b + 1]]), 0), 1)[:, None]
    raise ValueError(f"no gradient for {formula}")
