"""The ranges of agents' parameters, which the harness checks."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

__all__ = ["Count", "NotNegative", "Positive", "Share"]

Share = Annotated[float, Field(ge=0, le=1)]
Count = Annotated[int, Field(ge=1)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
