"""What an episode is worth at its end."""

from __future__ import annotations

from typing import Any

from stlbench import stl
from stlbench.contract import Array, Integers
from stlbench.errors import UsageError
from stlbench.rollout.early_ends import judge, without_end
from stlbench.rollout.wrapping.scoring import Scoring


def verdicts(scoring: Scoring, traces: Array, t: Integers) -> dict[str, Any]:
    """`robustness` and `satisfied` of r episodes that ended at steps t (r,).

    Args:
        scoring: what an early end means.
        traces: (r, T + 1, k), with the last sample held to the end. Changed in place.
        t: each in 1..T.

    Returns:
        Arrays (r,); under `interval` (r, 2): bounds of the robustness, and whether every and whether some continuation
        satisfies the formula.
    """
    specification = scoring.specification
    recorded = traces if scoring.terminated == "hold" else without_end(traces, t)
    try:
        found = judge(specification.formula, recorded, specification, scoring.terminated)
    except stl.UndefinedError as error:
        raise UsageError(f"formula: {error}") from error
    if scoring.terminated == "interval":
        return {"robustness": found.robustness, "satisfied": found.satisfied}
    return {"robustness": found.robustness[:, 0].copy(), "satisfied": found.satisfied[:, 0].copy()}
