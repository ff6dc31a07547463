"""What a cell leaves behind: frozen values that go to the ledger as JSON and come back equal."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Literal

import numpy as np
from pydantic import ConfigDict, TypeAdapter

__all__ = [
    "ACCIDENTS",
    "FORMAT",
    "MAIN",
    "CurvePoint",
    "Measurement",
    "Result",
    "Score",
    "Status",
    "from_json",
    "to_json",
]

FORMAT = 1
"""Version of what is recorded and of how it is computed; part of every cell's key."""

MAIN = "formula"
"""Name of the protocol that every task has: the task's own formula, from the starts kept for reporting."""

Status = Literal["done", "raised", "timeout", "killed", "intractable", "unsuitable"]
"""How a cell ended. `intractable` and `unsuitable` are findings about a method; the three before them are accidents."""

ACCIDENTS: tuple[Status, ...] = ("raised", "timeout", "killed")
"""What a retry runs again."""


@dataclass(frozen=True)
class Score:
    """What the referee found under one protocol, a value a start."""

    __pydantic_config__ = ConfigDict(ser_json_inf_nan="constants")

    robustness: tuple[float, ...]
    """Robustness of the protocol's formula at t = 0, in the unit of its predicates."""
    satisfied: tuple[bool, ...]
    """Boolean satisfaction, its own verdict: at robustness 0 the two need not agree."""
    first_failed: Mapping[str, int]
    """How many starts failed, by the conjunct that was lost first."""

    @property
    def mean(self) -> float:
        """Mean robustness over the starts."""
        return float(np.mean(self.robustness))

    @property
    def minimum(self) -> float:
        """Robustness from the worst start."""
        return float(np.min(self.robustness))

    @property
    def satisfaction(self) -> float:
        """Share of the starts that satisfy, in [0, 1]."""
        return float(np.mean(self.satisfied))


@dataclass(frozen=True)
class CurvePoint:
    """One checkpoint, scored on the starts kept for selection."""

    steps: int
    """Environment steps of one sampling time so far, all copies together."""
    cpu_seconds: float
    """CPU seconds of training so far."""
    satisfaction: float
    robustness_mean: float


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
    """CPU time of the method's reward a step and copy, in nanoseconds, measured apart on a batch of 1024."""
    inputs_added: int
    """Inputs that the method added to the policy's observation."""


@dataclass(frozen=True)
class Result:
    """One row of the ledger."""

    key: str
    """Hash of what can change the result (see `matrix.Cell`)."""
    task: str
    method: str
    """With its parameters as the user wrote them, in canonical order: funnel[ginf=0.02,variant=code]."""
    agent: str
    seed: int
    budget: str
    status: Status
    reason: str = ""
    """One line, where status is not `done`."""
    details: str = field(default="", repr=False)
    """Traceback, where there is one."""
    measurement: Measurement | None = None
    """Present exactly where status is `done`."""
    provenance: Mapping[str, str] = field(default_factory=dict)
    """Versions, machine, jobs beside it, time: what might explain a result without being part of its key."""

    @property
    def name(self) -> str:
        """The cell's human name: hold-disc/funnel/dqn/0."""
        return f"{self.task}/{self.method}/{self.agent}/{self.seed}"


@lru_cache
def _adapter() -> TypeAdapter[Result]:
    return TypeAdapter(Result)


def to_json(result: Result) -> str:
    """The result as one line of JSON."""
    return _adapter().dump_json(result).decode()


def from_json(text: str | bytes) -> Result:
    """The inverse of `to_json`. Raises `pydantic.ValidationError` on anything else."""
    return _adapter().validate_json(text)
