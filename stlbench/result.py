"""Which cell it is, and what it leaves behind: frozen values that go to the ledger as JSON and come back equal."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Annotated, Any, Literal, Self, cast, get_args

import numpy as np
from pydantic import BeforeValidator, ConfigDict, PlainSerializer, TypeAdapter

from stlbench.contract_parts.texts import one_line, printable
from stlbench.errors import UsageError, did_you_mean
from stlbench.registry.choices import Choice, choice_of, parse_choice

__all__ = [
    "ACCIDENTS",
    "FAILED",
    "IDENTITY",
    "MAIN",
    "NOT_RUN",
    "OUTSIDE",
    "RANDOM",
    "CellId",
    "CurvePoint",
    "Measurement",
    "Planned",
    "Result",
    "Score",
    "Setting",
    "Status",
    "StoredPolicies",
    "Summary",
    "Track",
    "accidents_of",
    "find_cell",
    "from_json",
    "plain_scores",
    "reported",
    "to_json",
]

MAIN = "formula"
"""Name of the protocol that every task has: the task's own formula, from the grid of starts that figures show."""

RANDOM = "random"
"""Name of the protocol that budgets may ask for: the task's own formula, from many starts drawn at random."""

Track = Literal["shared", "plain", "tuned", "outside"]
"""By which rules a cell was trained. `shared`: by the task's one recipe for all methods. `plain`: on the state and the
time alone, without any part of the task that is there to help, with the agent's defaults. `tuned`: by a recipe that was
found for this method, with the same budget of tuning for each. `outside`: stlbench did not train it, and scored it."""

OUTSIDE: Literal["outside"] = "outside"
"""The track of what stlbench did not train (`stlbench score`): no comparison and no statistic has it."""

Status = Literal["done", "raised", "timeout", "killed", "intractable", "unsuitable"]
"""How a cell ended. `intractable` and `unsuitable` are findings about a method; the three before them are accidents."""

NOT_RUN: Literal["not run"] = "not run"
"""In tables, in the place of a status: the cell was planned and has no result."""

ACCIDENTS: tuple[Status, ...] = ("raised", "timeout", "killed")
"""What a retry may run again."""

FAILED = "failed"
"""The word for all of them."""


def accidents_of(value: object) -> tuple[Status, ...]:
    """Which accidents are to be tried again: a comma list or the words themselves, `failed` for all; True is all too.

    Raises:
        UsageError: one of them is no accident.
    """
    if value is None or isinstance(value, bool):
        return ACCIDENTS if value else ()
    words = value.split(",") if isinstance(value, str) else list(value) if isinstance(value, Iterable) else [value]
    said = [str(word).strip() for word in words]
    for word in said:
        if word not in (*ACCIDENTS, FAILED):
            raise UsageError(f"no failure '{word}'{did_you_mean(word, (*ACCIDENTS, FAILED))}")
    return tuple(status for status in ACCIDENTS if status in said or FAILED in said)


# --------------------------------------------------------------------------------------------------------- identity

_Chosen = Annotated[Choice, BeforeValidator(choice_of), PlainSerializer(str)]
"""A choice, which JSON and tables write as its text."""


@dataclass(frozen=True, order=True)
class Setting:
    """What cells have in common that differ in nothing but the seed. Comparisons are made between settings."""

    task: _Chosen
    method: _Chosen
    agent: _Chosen
    budget: str
    track: Track = "shared"

    @property
    def name(self) -> str:
        """For people: hold-disc/funnel/dqn, without the budget; with the track where it is not `shared`."""
        return _joined(self.task, self.method, self.agent, track=self.track)


@dataclass(frozen=True, order=True)
class CellId:
    """Which cell: the one identity that plans, results, tables and the gate share."""

    task: _Chosen
    """The task, or an ablation of it: overlap[without=cuts]."""
    method: _Chosen
    """With the parameters that the user set: funnel[ginf=0.02,variant=code]."""
    agent: _Chosen
    seed: int
    budget: str
    track: Track = "shared"

    @classmethod
    def parse(cls, name: str, budget: str) -> Self:
        """The inverse of `name`, which does not say the budget. Raises `UsageError`."""
        parts = name.split("/")
        track = parts.pop() if len(parts) == 5 and parts[4] in get_args(Track) else "shared"
        if len(parts) != 4 or not (parts[3].isascii() and parts[3].isdigit()):
            raise UsageError(
                f"'{name}' names no cell; a name is task/method/agent/seed, as in hold-disc/funnel/dqn/0, "
                "and on another track than shared task/method/agent/seed/track"
            )
        task, method, agent = map(parse_choice, parts[:3])
        return cls(task, method, agent, int(parts[3]), budget, cast(Track, track))

    @property
    def name(self) -> str:
        """For people, and in the names of files: hold-disc/funnel/dqn/0. Budgets share it; tracks other than `shared`
        are at its end."""
        return _joined(self.task, self.method, self.agent, self.seed, track=self.track)

    @property
    def setting(self) -> Setting:
        """All but the seed."""
        return Setting(self.task, self.method, self.agent, self.budget, self.track)


def _joined(*parts: Choice | int, track: Track) -> str:
    return "/".join([*map(str, parts), *([] if track == "shared" else [track])])


IDENTITY = tuple(part.name for part in fields(CellId))
"""The names of the parts, which are columns of every table of cells."""


def find_cell(cells: Iterable[CellId], name: str, budget: str | None = None) -> CellId:
    """The one of the cells that a user names.

    Raises:
        UsageError: there is none of that name and budget, or several budgets and none is named.
    """
    known = list(cells)
    canonical = CellId.parse(name, budget or "").name
    budgets = {cell.budget: cell for cell in known if cell.name == canonical}
    if not budgets:
        raise UsageError(f"there is no cell '{name}'{did_you_mean(canonical, {cell.name for cell in known})}")
    if budget is None and len(budgets) > 1:
        raise UsageError(f"{name} has the budgets {', '.join(sorted(budgets))}; say which")
    if budget is not None and budget not in budgets:
        raise UsageError(f"{name} has no budget '{budget}'{did_you_mean(budget, budgets)}")
    return budgets[budget] if budget is not None else next(iter(budgets.values()))


# ----------------------------------------------------------------------------------------------------------- result


@dataclass(frozen=True)
class Summary:
    """What is left of a score whose single starts were not kept."""

    mean: float
    minimum: float
    """NaN where it was not kept either."""
    satisfaction: float
    starts: int | None = None
    """How many they were; None where that was not kept."""


@dataclass(frozen=True)
class Score:
    """What the referee found under one protocol, one value per start."""

    __pydantic_config__ = ConfigDict(ser_json_inf_nan="constants")

    robustness: tuple[float, ...]
    """Robustness of the protocol's formula at t = 0, in the unit of its predicates."""
    satisfied: tuple[bool, ...]
    """Boolean satisfaction, its own verdict: at robustness 0 the two need not agree."""
    first_failed: Mapping[str, int]
    """How many starts failed, by the conjunct that failed first."""
    summary: Summary | None = None
    """Instead of the values per start, which are empty then: of many starts no more is kept."""

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
    def starts(self) -> int | None:
        """How many starts; None where that was not kept."""
        return self.summary.starts if self.summary else len(self.robustness)

    def summarised(self) -> Score:
        """The same without the values per start."""
        kept = Summary(self.mean, self.minimum, self.satisfaction, self.starts)
        return Score((), (), self.first_failed, kept)


def reported(scores: Mapping[str, Score]) -> Score:
    """Of the scores of one policy, protocol -> score, the one that counts: from random starts where there is one."""
    return scores.get(RANDOM, scores[MAIN])


@dataclass(frozen=True)
class CurvePoint:
    """One checkpoint, scored on the starts kept for selection."""

    steps: int
    """Environment steps of one sampling time so far, all copies together."""
    cpu_seconds: float
    """CPU seconds of training so far."""
    satisfaction: float
    robustness_mean: float
    starts: int | None = None
    """From how many of these starts: a checkpoint that is clearly behind is scored from fewer than a good one. None in
    records that do not say it; there it is all."""


@dataclass(frozen=True)
class Planned:
    """What a policy that was planned, not learned, makes the most of (`Agent.plans`)."""

    __pydantic_config__ = ConfigDict(ser_json_inf_nan="constants")

    maximised: Literal["reward", "formula"]
    """The method's reward, or the formula's robustness."""
    value: float
    """What the plan expects, mean over the report's starts, in the unit of what is maximised; NaN where it does not
    say."""


@dataclass(frozen=True)
class StoredPolicies:
    """That a cell's policies are stored, by which hashes they are known, and what it takes to use them."""

    selected: str
    """SHA-256 of the arrays (`saved_policies.digest`), 64 hex digits."""
    final: str
    observation_size: int
    """D: numbers in the observations that they act on."""
    agent: Mapping[str, str | int | float | bool] = field(default_factory=dict)
    """On the track `tuned`, what the recipe says of the agent; empty on others, as the task says it."""
    hold: int | None = None
    """On the track `tuned`, the steps for which the recipe holds an action; None where that is the task's own."""


@dataclass(frozen=True)
class Measurement:
    """All that one finished cell measured."""

    selected: Mapping[str, Score]
    """Protocol -> score of the best checkpoint, chosen on other starts than these. `MAIN` is always there."""
    final: Mapping[str, Score]
    """The same for the policy at the end of training."""
    selected_steps: int
    """Environment steps at which the selected checkpoint was taken."""
    curve: tuple[CurvePoint, ...]
    training_cpu_seconds: float
    """CPU seconds of training alone, without evaluations."""
    training_wall_seconds: float
    cpu_seconds: float
    """CPU seconds of the whole cell: training, checkpoints, evaluation."""
    wall_seconds: float
    env_steps: int
    """Environment steps of one sampling time that training used."""
    reward_nanoseconds: float
    """CPU time of the method's reward per step and copy, in nanoseconds, measured apart on a batch of 1024."""
    inputs_added: int
    """Inputs that the method added to the policy's observation."""
    planned: Planned | None = None
    """None for policies that were learned, and so in all records of before there were others."""
    extension: str = ""
    """Why the task is outside the form that the method's source was published for; empty inside it."""
    policies: StoredPolicies | None = None
    """None where no policy is stored: a planner's, an agent's that keeps none, and those of older records."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "extension", one_line(self.extension))


@dataclass(frozen=True)
class Result:
    """One row of the ledger. Its texts, which plugins wrote, are safe for any file and any terminal."""

    id: CellId
    key: str
    """Hash of what can change the result (see `plan.Cell`)."""
    status: Status
    reason: str = ""
    """One line, where status is not `done`."""
    details: str = field(default="", repr=False)
    """Traceback, where there is one."""
    measurement: Measurement | None = None
    """Present exactly where status is `done`."""
    provenance: Mapping[str, str] = field(default_factory=dict)
    """Versions, machine, jobs beside it, time: what might explain a result without being part of its key."""

    def __post_init__(self) -> None:
        provenance = {printable(name): printable(text) for name, text in self.provenance.items()}
        safe = {"reason": one_line(self.reason), "details": printable(self.details), "provenance": provenance}
        for name, value in safe.items():
            object.__setattr__(self, name, value)


@lru_cache
def _adapter() -> TypeAdapter[Result]:
    return TypeAdapter(Result)


def to_json(result: Result) -> str:
    """The result as one line of JSON, the parts of its identity beside the rest."""
    content = _adapter().dump_python(result, mode="json")
    return json.dumps({**content.pop("id"), **content})


def plain_scores(scores: Mapping[str, Score]) -> dict[str, Any]:
    """Protocol -> score as `to_json` writes it within a measurement."""
    plain: dict[str, Any] = TypeAdapter(dict[str, Score]).dump_python(dict(scores), mode="json")
    return plain


def from_json(text: str | bytes) -> Result:
    """The inverse of `to_json`. Raises `ValueError` on anything else."""
    try:
        content = json.loads(text)
    except RecursionError as error:
        raise ValueError("brackets inside brackets, too deep to read") from error
    if not isinstance(content, dict):
        raise ValueError(f"expected an object, got {text!r:.80}")
    identity = {name: content.pop(name) for name in IDENTITY if name in content}
    return _adapter().validate_python({"id": identity, **content})
