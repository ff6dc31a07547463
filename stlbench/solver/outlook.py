"""Whether a certificate can still rise: a look at a policy from fresh starts, which are not those of the certificate.

A policy that satisfies from all starts for selection may fail from others. Nothing can satisfy from some starts.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from stlbench import stl
from stlbench.records.result import Result
from stlbench.search.actor import of_cell, space_of

_SEED = 1
"""The seed of the fresh starts; those of a certificate have another."""


class Outlook(NamedTuple):
    """The results of a policy from fresh starts."""

    starts: int
    satisfied: int
    lost: int
    """Starts whose first sample violates the formula, whatever follows."""

    @property
    def can_rise(self) -> bool:
        """Whether another policy may satisfy from more starts."""
        return self.satisfied + self.lost < self.starts

    def __str__(self) -> str:
        return f"{self.satisfied} of {self.starts} further starts satisfy"


def outlook(folder: Path, result: Result, starts: int) -> Outlook:
    """The outlook of a cell's selected policy, from so many starts. Raises `UsageError` where it cannot act."""
    actor = of_cell(folder, result)
    space = space_of(actor.task)
    played = actor.play(space.draw(np.random.default_rng(_SEED), 1 if space.single else starts))
    _, possible = stl.satisfaction_bounds(actor.task.formula, played.traces[:, :1], tuple(actor.task.signals))
    return Outlook(len(played.satisfied), int(played.satisfied.sum()), int((~possible).sum()))
