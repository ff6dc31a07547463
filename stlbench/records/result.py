"""The result of a cell: how it ended, and frozen values that go to the ledger as JSON and come back equal."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, ConfigDict

from stlbench.errors import UsageError, did_you_mean, one_line, printable
from stlbench.records.identity import (
    IDENTITY,
    Amount,
    Count,
    Digest,
    Finite,
    Line,
    Name,
    ReadCell,
    Robustness,
    Share,
    Verdict,
    Whole,
    adapter,
    safe_line,
    valid,
)
from stlbench.records.observation import Described

Status = Literal["done", "raised", "timeout", "killed", "intractable", "unsuitable"]
"""How a cell ended. `intractable` and `unsuitable` are findings about a method; the three before them are accidents."""
NOT_RUN: Literal["not run"] = "not run"
"""In tables, in the place of a status: the cell was planned and has no result."""
NOT_SCORED: Literal["not scored"] = "not scored"
"""The same: the referee could not score its policy again, so that the score that was claimed is left out."""
ACCIDENTS: tuple[Status, ...] = ("raised", "timeout", "killed")
"""The statuses that a retry may run."""
FAILED = "failed"
"""The word for all accidents."""


def accidents_of(value: object) -> tuple[Status, ...]:
    """The accidents that a retry runs: a comma list or the words themselves; `failed` and True are all of them.

    Raises:
        UsageError: one of them is no accident.
    """
    if value is None or isinstance(value, bool):
        return ACCIDENTS if value else ()
    words: list[object] = [value]
    if isinstance(value, str):
        words = list(value.split(","))
    elif isinstance(value, Iterable) and not isinstance(value, Mapping):
        words = list(value)
    given = [str(word).strip() for word in words]
    for word in given:
        if word not in (*ACCIDENTS, FAILED):
            raise UsageError(f"no failure '{word}'{did_you_mean(word, (*ACCIDENTS, FAILED))}")
    return tuple(status for status in ACCIDENTS if status in given or FAILED in given)


TASK_FOLDER = "task_folder"
"""Among the facts of a result's provenance, where its task is a folder: where that was."""
LEARNED = 0.95
"""A policy that satisfies the formula from this share of the starts has learned the task."""
MAIN = "formula"
"""Name of the protocol that every task has: the task's own formula, from the grid of starts that figures show."""
RANDOM = "random"
"""Name of the protocol that budgets may ask for: the task's own formula, from many starts drawn at random."""


@dataclass(frozen=True)
class Summary:
    """A score without the values of single starts."""

    mean: Robustness
    minimum: Robustness
    """NaN if it was not recorded, which no row says."""
    satisfaction: Share
    starts: Count
    """The number of starts."""


@dataclass(frozen=True)
class Score:
    """The referee's result under one protocol, one value for each start."""

    __pydantic_config__ = ConfigDict(ser_json_inf_nan="constants")

    robustness: tuple[Robustness, ...]
    """Robustness of the protocol's formula at t = 0, in the unit of its predicates."""
    satisfied: tuple[Verdict, ...]
    """Boolean satisfaction, its own verdict: at robustness 0 the two need not agree."""
    first_failed: Mapping[Line, Count]
    """How many starts failed, by the conjunct that failed first."""
    summary: Summary | None = None
    """Instead of the values per start, which are then empty; for many starts only this is stored."""
    ended_early: Share | None = field(default=None, compare=False)
    """Share of the starts, in [0, 1], from which the environment ended the episode before the formula's horizon; None
    where it was not counted. It is no part of the verdict."""

    @property
    def mean(self) -> float:
        """Mean robustness over the starts."""
        return self.summary.mean if self.summary else float(np.mean(self.robustness))

    @property
    def minimum(self) -> float:
        """Robustness from the worst start."""
        return self.summary.minimum if self.summary else float(np.min(self.robustness))

    @property
    def satisfaction(self) -> float:
        """Share of the starts that satisfy, in [0, 1]."""
        return self.summary.satisfaction if self.summary else float(np.mean(self.satisfied))

    @property
    def learned(self) -> bool:
        return self.satisfaction >= LEARNED

    @property
    def starts(self) -> int:
        """The number of starts."""
        return self.summary.starts if self.summary else len(self.robustness)

    def summarised(self) -> Score:
        """The same without the values per start."""
        summary = Summary(self.mean, self.minimum, self.satisfaction, self.starts)
        return Score((), (), self.first_failed, summary, self.ended_early)


def _possible(score: Score) -> Score:
    counts = {len(score.robustness), len(score.satisfied)}
    if counts == {0} and score.summary is None:
        raise ValueError("it is of no start")
    if len(counts) == 2 or (counts != {0} and score.summary is not None):
        raise ValueError("it should have a robustness and a verdict for each start, or a summary alone")
    if sum(score.first_failed.values()) > score.starts:
        raise ValueError(f"first_failed has more than its {score.starts} starts")
    return score


def reported(scores: Mapping[str, Score]) -> Score:
    """The score that counts among those of one policy, protocol -> score: from random starts where there is one."""
    return scores.get(RANDOM, scores[MAIN])


@dataclass(frozen=True, slots=True)
class CurvePoint:
    """One checkpoint, scored on the starts for selection."""

    steps: Whole
    """Environment steps of one sampling time so far, all copies together."""
    cpu_seconds: Amount
    """CPU seconds of training so far."""
    satisfaction: Share
    robustness_mean: Finite
    starts: Count
    """The number of these starts: a checkpoint that is clearly behind is scored from fewer than a good one."""


@dataclass(frozen=True)
class Planned:
    """The quantity that a policy maximises that was planned, not learned (`Agent.plans`)."""

    __pydantic_config__ = ConfigDict(ser_json_inf_nan="constants")

    maximised: Literal["reward", "formula"]
    """The method's reward, or the formula's robustness."""
    value: float
    """The plan's expected value, mean over the report's starts, in the unit of what is maximised; NaN where it does not
    say."""


@dataclass(frozen=True)
class StoredPolicies:
    """The hashes of a cell's stored policies, and what is needed to use them."""

    selected: Digest
    """SHA-256 of the arrays (`array_files.digest`), 64 hex digits."""
    final: Digest
    observation_size: Whole
    """D: numbers in the observations that they act on."""
    agent: Mapping[str, str | int | float | bool] = field(default_factory=dict)
    """The recipe's parameters of the agent on the track `tuned`; empty on other tracks, where the task has them."""
    hold: Count | None = None
    """The steps for which the recipe holds an action on the track `tuned`; None if the task's own number holds."""
    observation: Described | None = None
    """The meaning of the numbers of their observations; None where it was not recorded."""


_Score = Annotated[Score, AfterValidator(_possible)]


@dataclass(frozen=True)
class Measurement:
    """The measurements of one finished cell."""

    selected: Mapping[Line, _Score]
    """Protocol -> score of the best checkpoint, chosen on other starts than these. `MAIN` is always there."""
    final: Mapping[Line, _Score]
    """The same for the policy at the end of training, by the same protocols."""
    selected_steps: Whole
    """Environment steps at which the selected checkpoint was taken."""
    curve: tuple[CurvePoint, ...]
    training_cpu_seconds: Amount
    """CPU seconds of training alone, without evaluations."""
    training_wall_seconds: Amount
    cpu_seconds: Amount
    """CPU seconds of the whole cell: training, checkpoints, evaluation."""
    wall_seconds: Amount
    env_steps: Whole
    """Environment steps of one sampling time that training used."""
    reward_nanoseconds: Amount
    """CPU time of the method's reward per step and copy, in nanoseconds, measured apart on a batch of 1024."""
    inputs_added: Whole
    """Inputs that the method added to the policy's observation."""
    planned: Planned | None = None
    """None for policies that were learned."""
    extension: str = ""
    """Why the task is outside the form that the method's source was published for; empty inside it."""
    policies: StoredPolicies | None = None
    """None if no policy is stored, as for planners, and for agents that store none."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "extension", one_line(self.extension))

    @property
    def selection(self) -> CurvePoint:
        """The selected checkpoint, scored on the starts for selection."""
        return next(point for point in self.curve if point.steps == self.selected_steps)

    @property
    def score(self) -> Score:
        """The score that counts of the selected policy."""
        return reported(self.selected)

    @property
    def final_score(self) -> Score:
        """The same of the policy at the end of training."""
        return reported(self.final)

    def summarised(self) -> Measurement:
        """The same without the values per start and the stored policies, so that thousands fit into memory."""
        selected, final = (
            {protocol: score.summarised() for protocol, score in scores.items()}
            for scores in (self.selected, self.final)
        )
        return replace(self, selected=selected, final=final, policies=None)


class Datum(NamedTuple):
    """One value of a finished cell, where it has a column."""

    path: str
    """Its attribute of a `Measurement`. Where all cells lack one that is None by default, as `planned`, a table of them
    has no column for it."""
    ledger: bool = False
    """Whether a ledger has it as a column, a REAL, for queries by SQL."""
    log: str = ""
    """The name of the number in logs; empty where they do not have it."""

    def of(self, measurement: Measurement) -> Any:
        value: Any = measurement
        for name in self.path.split("."):
            value = None if value is None else getattr(value, name)
        return value


SCHEMA: Mapping[str, Datum] = {
    "robustness_mean": Datum("score.mean", ledger=True, log="robustness"),
    "robustness_min": Datum("score.minimum"),
    "satisfaction": Datum("score.satisfaction", ledger=True, log="satisfaction"),
    "final_robustness_mean": Datum("final_score.mean", log="final_robustness"),
    "final_satisfaction": Datum("final_score.satisfaction", log="final_satisfaction"),
    "selected_steps": Datum("selected_steps"),
    "training_cpu_seconds": Datum("training_cpu_seconds", ledger=True),
    "training_wall_seconds": Datum("training_wall_seconds", ledger=True),
    "cpu_seconds": Datum("cpu_seconds", log="cpu_seconds"),
    "wall_seconds": Datum("wall_seconds", log="wall_seconds"),
    "env_steps": Datum("env_steps", log="env_steps"),
    "reward_nanoseconds": Datum("reward_nanoseconds"),
    "inputs_added": Datum("inputs_added"),
    "starts": Datum("score.starts"),
    "extension": Datum("extension"),
    "ended_early": Datum("score.ended_early"),
    "maximised": Datum("planned.maximised"),
    "grid_value": Datum("planned.value"),
}
"""Column -> value, for ledgers, cells.csv, tables in Python, logs and the gate. A new one is a line here, and above an
attribute with a default, as earlier results lack it."""


def _complete(measured: Measurement) -> Measurement:
    if MAIN not in measured.selected:
        raise ValueError(f"selected has no score by the protocol {MAIN}")
    if measured.selected.keys() != measured.final.keys():
        raise ValueError("selected and final have other protocols")
    if measured.curve and all(point.steps != measured.selected_steps for point in measured.curve):
        raise ValueError(f"the curve has no checkpoint at selected_steps, {measured.selected_steps}")
    return measured


@dataclass(frozen=True)
class Result:
    """One row of the ledger. Its texts, which plugins wrote, are safe for any file and any terminal.

    The annotations, and the functions that they name, are the rules for a row that is read (`from_json`).
    """

    id: ReadCell
    key: Name
    """Hash of what can change the result (see `plan.Cell`)."""
    status: Status
    reason: str = ""
    """One line, where status is not `done`."""
    details: str = field(default="", repr=False)
    """Traceback, where there is one."""
    measurement: Annotated[Measurement, AfterValidator(_complete)] | None = None
    """Present exactly where status is `done`."""
    provenance: Mapping[str, str] = field(default_factory=dict)
    """Versions, machine, jobs, time: facts that may explain a result and are no part of its key."""

    @property
    def measured(self) -> Measurement:
        """The measurement, of a cell that is done."""
        assert self.measurement is not None
        return self.measurement

    @property
    def how(self) -> str:
        """The end of the cell: "raised: ValueError: no luck"."""
        return f"{self.status}: {self.reason}" if self.reason else self.status

    def __post_init__(self) -> None:
        provenance = {safe_line(name): safe_line(text) for name, text in self.provenance.items()}
        safe = {"reason": one_line(self.reason), "details": printable(self.details), "provenance": provenance}
        for name, value in safe.items():
            object.__setattr__(self, name, value)


def _measured_if_done(result: Result) -> Result:
    if (result.measurement is not None) != (result.status == "done"):
        raise ValueError("a cell has a measurement exactly where its status is done")
    return result


_Read = Annotated[Result, AfterValidator(_measured_if_done)]


def to_json(result: Result) -> str:
    """The result as one line of JSON. The parts of its identity are keys at the top level."""
    content = adapter(_Read).dump_python(result, mode="json")
    return json.dumps({**content.pop("id"), **content})


def plain_scores(scores: Mapping[str, Score]) -> dict[str, Any]:
    """Protocol -> score as `to_json` writes it within a measurement."""
    plain: dict[str, Any] = adapter(dict[str, Score]).dump_python(dict(scores), mode="json")
    return plain


def plain(text: str | bytes) -> Any:
    """The value of a text of JSON that may be of a stranger. Raises `ValueError`."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise ValueError("brackets inside brackets, too deep to read") from error


def from_json(text: str | bytes) -> Result:
    """The inverse of `to_json`. Raises `ValueError` on anything else, in one line: which rule is broken, and where."""
    content = plain(text)
    if not isinstance(content, dict):
        raise ValueError(f"expected an object, got {text!r:.80}")
    identity = {name: content.pop(name) for name in IDENTITY if name in content}
    result: Result = valid(_Read, {**content, "id": identity})
    return result
