"""How training episodes differ from those that the referee scores."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo

from stlbench import stl
from stlbench.task.entry import Count, Entry, Read, read_point_formula
from stlbench.task.region import Region

VIOLATION: Literal["violation"] = "violation"
"""Where a term G[a,b] psi of the formula is violated."""


def _read_where(value: Any, info: ValidationInfo) -> stl.Formula | Literal["violation"]:
    return VIOLATION if value == VIOLATION else read_point_formula(value, info)


class Ending(Entry):
    """Where a training episode ends early, as if the least that the method pays (`floor`) were paid for ever after."""

    where: Annotated[stl.Formula | Literal["violation"], Read(_read_where)]
    """A formula without temporal operators over the signals, such as of a pole that fell; or `VIOLATION`."""


class Exploring(Entry):
    """Training episodes that begin at a random time of the task, a decision's, instead of at its start."""

    share: Annotated[float, Field(gt=0, le=1)]
    """Of the training episodes."""
    kept: Annotated[float, Field(ge=0, le=1)] = 0.0
    """Of these, the share that begins in the state in which the copy's last episode ended."""
    states: Region | None = None
    """Where the others begin; among the states from which episodes start where left out."""
    length: Count | None = None
    """They are broken off after this many decisions on average; at the end of the task where left out."""


class TrainingEpisodes(Entry):
    """How training episodes differ from those that the referee scores, the same for every method and agent."""

    starts: Region | None = None
    """Where episodes start; `initial` where left out."""
    cuts: tuple[Count, ...] = ()
    """Phase boundaries, steps at which the reward begins to ask for something else. A return stops there, with the
    value of going on as before: an agent that looks across leaves too early (anticipation)."""
    ends: tuple[Ending, ...] = ()
    """Where episodes end early."""
    exploring: Exploring | None = None
