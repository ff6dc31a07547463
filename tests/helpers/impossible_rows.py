"""Rows that no run writes, with a checksum that is right: what a stranger's ledger may hold."""

from __future__ import annotations

import copy
import json
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from helpers.ledgers import say
from helpers.synthetic_results import plan, result
from stlbench.records.identity import IDENTITY
from stlbench.records.ledger import LEDGER
from stlbench.records.observation import Observation
from stlbench.records.result import RANDOM, Result, Score, StoredPolicies, Summary, to_json
from stlbench.records.rows import checksum_of

Place = tuple[str | int, ...]
FORMULA = ("measurement", "selected", "formula")
DELETED = object()
SUMMARY = {"mean": 0.1, "minimum": 0.0, "satisfaction": 1.0}
NO_START: dict[Place, Any] = {(*FORMULA, "robustness"): [], (*FORMULA, "satisfied"): []}
IMPOSSIBLE: dict[str, dict[Place, Any]] = {
    "no robustness of any start": NO_START,
    "fewer verdicts than starts": {(*FORMULA, "satisfied"): [True]},
    "robustness that is no number": {(*FORMULA, "robustness"): [float("nan"), 0.4]},
    "starts beside their summary": {(*FORMULA, "summary"): SUMMARY | {"starts": 2}},
    "a summary of no start": NO_START | {(*FORMULA, "summary"): SUMMARY | {"starts": 0}},
    "a conjunct that failed first from no start": {(*FORMULA, "first_failed"): {"x > 0": 0}},
    "more failures than starts": {(*FORMULA, "first_failed"): {"x > 0": 3}},
    "no score by the formula": {("measurement", "selected"): {}},
    "no score of the final policy": {("measurement", "final"): {}},
    "a protocol of one policy alone": {
        ("measurement", "final", "end"): {"robustness": [1.0], "satisfied": [True], "first_failed": {}}
    },
    "more steps than there can be": {("measurement", "env_steps"): 10**400},
    "an unsigned number": {("measurement", "inputs_added"): 2**63},
    "less than no time": {("measurement", "cpu_seconds"): -1.0},
    "endless time": {("measurement", "wall_seconds"): float("inf")},
    "a text in the place of a number": {("measurement", "env_steps"): "many"},
    "True in the place of a number": {("measurement", "env_steps"): True},
    "a checkpoint that is not there": {("measurement", "selected_steps"): 1234},
    "a checkpoint that satisfies twice": {("measurement", "curve", 0, "satisfaction"): 2.0},
    "a hash that is none": {("measurement", "policies", "selected"): "../x"},
    "an observation with half of its scales": {("measurement", "policies", "observation", "reach"): [1.0]},
    "done and not measured": {("measurement",): None},
    "measured and not done": {("status",): "killed"},
    "no status": {("status",): "odd"},
    "a seed that no run takes": {("seed",): 10**40},
    "a negative seed": {("seed",): -1},
    "a task that is a path": {("task",): {"name": "../../x", "parameters": []}},
    "a name that no file can have": {("method",): f"m[a={'x' * 300}]"},
    "a budget with a line break": {("budget",): "quick\nfast"},
    "a key with NUL": {("key",): "a\x00b"},
    "no key": {("key",): ""},
    "a fact that is a list": {("provenance", "machine"): ["x"]},
    "no provenance": {("provenance",): None},
}
"""What is wrong -> where the row says what."""


def rich(seed: int = 0) -> Result:
    """A cell that has everything: random starts in a summary, policies with their observation, facts."""
    made = result("raw", seed, robustness=(0.3, -0.4), first_failed={"x > 0": 1})
    assert made.measurement is not None
    of_random = {RANDOM: Score((), (), {"x > 0": 3}, Summary(0.5, -0.2, 0.7, 10), 0.25)}
    observation = Observation(2, ("x", "y"), (0.0, 0.0), (1.0, 2.0), steps=10, task="hold-disc", version="0.1.0")
    measured = replace(
        made.measurement,
        selected={**made.measurement.selected, **of_random},
        final={**made.measurement.final, **of_random},
        policies=StoredPolicies("a" * 64, "b" * 64, 3, {"rate": 0.5}, 2, observation),
    )
    facts = {"jobs": "2", "time": "2026-01-01T00:00:00+00:00", "code": "harness 12ab, task 34cd", "machine": "m"}
    return replace(made, measurement=measured, provenance=facts)


def several() -> list[Result]:
    """One of each kind: trained, planned, raised, intractable, and from outside."""
    outside = result("flag", agent="mine", track="outside", curve=(), selected_steps=0)
    source = {"source": "f.zip", "sha256": "0" * 64, "begun_at": "the report's starts"}
    return [
        rich(),
        plan(),
        result("mine", status="raised", reason="ValueError: x"),
        result("wide", status="intractable", reason="needs 600 inputs, limit 512"),
        replace(outside, provenance=source),
    ]


def changed(row: Any, changes: dict[Place, Any]) -> Any:
    """The row as plain values, with others in these places; `DELETED` takes one out."""
    row = copy.deepcopy(row)
    for place, value in changes.items():
        inside = row
        for name in place[:-1]:
            inside = inside[name]
        if value is DELETED:
            del inside[place[-1]]
        else:
            inside[place[-1]] = value
    return row


def plain(made: Result) -> Any:
    return json.loads(to_json(made))


def places(value: Any, above: Place = ()) -> Iterator[Place]:
    """Of every value within a row; of a list the first two alone."""
    inside = value.items() if isinstance(value, dict) else enumerate(value[:2]) if isinstance(value, list) else ()
    for name, part in inside:
        yield (*above, name)
        yield from places(part, (*above, name))


def insert(folder: Path, row: Any, like: Any) -> None:
    """Write a row of plain values into the ledger of a folder; its columns say as much of it as they can."""
    text = json.dumps(row)
    columns = {name: _column(row, like, name) for name in ("key", *IDENTITY, "status")}
    columns |= {"reason": "", "recorded_at": "", "result": text, "checksum": checksum_of(text), "files": "{}"}
    columns |= {"failures": 0, "again": 0}
    names, marks = ", ".join(columns), ", ".join("?" * len(columns))
    say(folder / LEDGER, f"INSERT OR REPLACE INTO cells ({names}) VALUES ({marks})", values=tuple(columns.values()))


def _column(row: Any, like: Any, name: str) -> Any:
    value = row.get(name) if isinstance(row, dict) else None
    if isinstance(value, str) and isinstance(like[name], str) and value.isascii():
        return value
    return value if type(value) is int is type(like[name]) and abs(value) < 2**63 else like[name]
