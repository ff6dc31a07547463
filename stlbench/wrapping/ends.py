"""What an episode is worth at its end, and what an end before the last step is paid."""

from __future__ import annotations

from typing import Any

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Specification
from stlbench.errors import UsageError
from stlbench.wrapping.scoring import Scoring

__all__ = ["greatest_and_least", "remainder", "verdicts"]


def remainder(scoring: Scoring, last: Array, action: Array, t: int, memory: Array) -> float:
    """What an end at step t is paid beside its own step, in the method's unit; 0 at the last step.

    Args:
        scoring: `hold` pays what the method pays while the last sample stays, `violated` its floor for each step that
            is left, `interval` nothing. Later rewards count by the discount.
        last: the sample (k,) at t.
        action: the last one, (1, axes).
        t: step of the sample, in 1..T.
        memory: at t, (1, m).
    """
    left = scoring.specification.steps - t
    if left == 0 or scoring.terminated == "interval":
        return 0.0
    weights = scoring.discount ** np.arange(1.0, left + 1)
    if scoring.terminated == "violated":
        return float(scoring.method.floor * weights.sum())
    samples = np.tile(last, (left + 1, 1, 1))
    rewards, _ = scoring.method.along(samples, action, np.array([t]), memory)
    return float(weights @ rewards[:, 0])


def verdicts(scoring: Scoring, traces: Array, t: Integers) -> dict[str, Any]:
    """`robustness` and `satisfied` of r episodes that ended at steps t (r,).

    Args:
        scoring: what an early end means.
        traces: (r, T + 1, k), with the last sample held to the end.
        t: each in 1..T.

    Returns:
        Arrays (r,); under `interval` (r, 2): bounds of the robustness, and whether every and whether some continuation
        satisfies the formula.
    """
    try:
        if scoring.terminated == "interval":
            return _bounds(scoring.specification, traces, t)
        robustness, satisfied = _values(scoring.specification, traces)
    except stl.UndefinedError as error:
        raise UsageError(f"formula: {error}") from error
    if scoring.terminated == "violated" and (early := t < scoring.specification.steps).any():
        robustness[early] = greatest_and_least(scoring.specification, scoring.specification.formula)[1]
        satisfied[early] = False
    return {"robustness": robustness, "satisfied": satisfied}


def greatest_and_least(specification: Specification, node: stl.Formula) -> tuple[float, float]:
    """Sound bounds of a formula's robustness over all traces whose signals stay in their ranges."""
    match node:
        case stl.Predicate():
            low, high = specification.range(node)
            return high, low
        case stl.Not(arg):
            high, low = greatest_and_least(specification, arg)
            return -low, -high
        case stl.Implies(left, right):
            return greatest_and_least(specification, stl.Or((stl.Not(left), right)))
        case stl.Always(_, _, arg) | stl.Eventually(_, _, arg):
            return greatest_and_least(specification, arg)
        case stl.Until(_, _, left, right):
            both = greatest_and_least(specification, stl.And((left, right)))
            return greatest_and_least(specification, right)[0], both[1]
        case stl.And(args) | stl.Or(args):
            pick = min if isinstance(node, stl.And) else max
            highs, lows = zip(*(greatest_and_least(specification, arg) for arg in args), strict=True)
            return pick(highs), pick(lows)
        case _:
            return np.inf, np.inf


def _values(specification: Specification, traces: Array) -> tuple[Array, Any]:
    formula, names = specification.formula, specification.signals
    return stl.robustness(formula, traces, names), stl.satisfied(formula, traces, names)


def _bounds(specification: Specification, traces: Array, t: Integers) -> dict[str, Any]:
    formula, names = specification.formula, specification.signals
    robustness, satisfied = np.empty((len(t), 2)), np.empty((len(t), 2), dtype=np.bool_)
    for last in np.unique(t):
        known = traces[t == last, : last + 1]
        robustness[t == last] = np.stack(stl.robustness_bounds(formula, known, names), axis=-1)
        satisfied[t == last] = np.stack(stl.satisfaction_bounds(formula, known, names), axis=-1)
    return {"robustness": robustness, "satisfied": satisfied}
