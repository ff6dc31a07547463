"""Types of the parameters of agents: ranges, which the harness checks."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

Share = Annotated[float, Field(ge=0, le=1)]
ShareBelow1 = Annotated[float, Field(ge=0, lt=1)]
Count = Annotated[int, Field(ge=1)]
Whole = Annotated[int, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Widths = Annotated[tuple[Count, ...], Field(min_length=1)]
"""Widths of the hidden layers of a network."""
Head = Literal["joint", "additive"]
"""How the outputs of a Q-network stand for actions (see `stlbench_agents.q_learner`)."""
