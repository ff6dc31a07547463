"""How far what asks for no learning stays from the witness: the tier of a task, by what was measured alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

TIERS = {"near": 4.0, "middle": 7.0, "far": float("inf")}
"""Tier -> the distance below which a task is in it. The numbers part the tasks of the suite into thirds, about."""


def distance(facts: Mapping[str, Any]) -> float:
    """How much more robustness the witness has than the best baseline, in units of the witness's own robustness.

    The baselines are the action zero, the best constant action and random actions. 1 would be a baseline that just
    satisfies.
    """
    witness = facts["robustness"]
    best = max(score["robustness"] for score in facts["baselines"].values())
    return float((witness - best) / witness)


def tier(facts: Mapping[str, Any]) -> str:
    """The tier of a task."""
    return next(name for name, end in TIERS.items() if distance(facts) < end)
