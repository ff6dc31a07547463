"""Synthetic results: the fewest words that make a cell's result, for tests of what is done with results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal

from stlbench.records.identity import CellId, Track
from stlbench.records.result import MAIN, CurvePoint, Measurement, Planned, Result, Score, Status
from stlbench.registry.choices import Choice
from stlbench.tracks.references import Likeness, References


def score(robustness: Sequence[float], first_failed: Mapping[str, int] | None = None) -> Score:
    """A score that satisfies from exactly the starts with positive robustness."""
    return Score(tuple(robustness), tuple(value > 0 for value in robustness), first_failed or {})


def measurement(
    robustness: Sequence[float] = (0.3, 0.4),
    final: Sequence[float] | None = None,
    further: Mapping[str, Sequence[float]] | None = None,
    first_failed: Mapping[str, int] | None = None,
    **numbers: Any,
) -> Measurement:
    """What a finished cell measured, from the robustness of its starts."""
    values: dict[str, Any] = {
        **{"selected_steps": 2000, "env_steps": 2000, "reward_nanoseconds": 21.0, "inputs_added": 0},
        "curve": (CurvePoint(1000, 1.0, 0.5, -0.1, 16), CurvePoint(2000, 2.0, 1.0, 0.3, 64)),
        **{"training_cpu_seconds": 10.0, "training_wall_seconds": 12.0, "cpu_seconds": 14.0, "wall_seconds": 16.0},
    } | numbers
    others = {name: score(entry) for name, entry in (further or {}).items()}
    return Measurement(
        selected={MAIN: score(robustness, first_failed)} | others,
        final={MAIN: score(robustness if final is None else final)} | others,
        **values,
    )


def result(
    method: str = "funnel",
    seed: int = 0,
    status: Status = "done",
    *,
    task: str = "hold-disc",
    agent: str = "dqn",
    budget: str = "quick",
    track: Track = "shared",
    reason: str = "",
    jobs: int | None = 2,
    **measured: Any,
) -> Result:
    """What one cell left behind; `measured` is passed to `measurement` where status is `done`."""
    name = f"{task}/{method}/{agent}/{seed}" + ("" if track == "shared" else f"/{track}")
    return Result(
        CellId.parse(name, budget),
        key=f"{name}/{budget}",
        status=status,
        reason=reason,
        measurement=measurement(**measured) if status == "done" else None,
        provenance={} if jobs is None else {"jobs": str(jobs)},
    )


def by_hand(**robustness: Sequence[float]) -> dict[str, References]:
    """Tasks, with _ for -, of which nothing is known but what their controllers get from the starts."""
    return {task.replace("_", "-"): References(score(values)) for task, values in robustness.items()}


def alike(task: str, **pairs: Likeness) -> dict[tuple[Choice, Track, frozenset[str]], Likeness]:
    """For `References.alike`: one_other="=" says that these two methods pay the same, on the track shared."""
    return {(Choice(task), "shared", frozenset(names.split("_"))): likeness for names, likeness in pairs.items()}


def plan(
    method: str = "funnel",
    agent: str = "planner",
    value: float = 1.0,
    maximised: Literal["reward", "formula"] = "reward",
    **words: Any,
) -> Result:
    """What an agent that plans left behind; further words are those of `result`."""
    planned = {} if words.get("status", "done") != "done" else {"planned": Planned(maximised, value)}
    return result(method, agent=agent, **planned, **words)
