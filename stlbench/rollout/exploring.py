"""The states in which training episodes begin that explore (`stlbench.task.file.Exploring`)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers
from stlbench.stl import Formula
from stlbench.task.entry import Region
from stlbench.task.file import Near
from stlbench.task.starts import sampled_states
from stlbench.task.task import Task

_TRIED = 4096
_NEAR = 0.5
"""The share of drawn states that fulfil a condition of `near`. The others keep the whole region in view."""


def fulfilling(task: Task, region: Region, conditions: Sequence[Formula]) -> list[Array]:
    """For each condition on the signals the states (n, k) that fulfil it, of 4096 from a region, always the same."""
    if not conditions:
        return []
    states = sampled_states(task.system, region, np.random.default_rng(0), _TRIED)
    signals = task.system.signals(states)
    return [states[stl.holds(condition, task.signals)(signals)] for condition in conditions]


class ExploringStates:
    """Draws states from the region `exploring.states`, half of them where `exploring.near` says."""

    def __init__(self, task: Task, region: Region, near: Sequence[Near]) -> None:
        """A condition that no state fulfils is left out."""
        self._task, self._region = task, region
        found = zip(near, fulfilling(task, region, [each.where for each in near]), strict=True)
        self._near = sorted(((each.until, states) for each, states in found if len(states)), key=lambda pair: pair[0])
        self._ends = np.array([until for until, _ in self._near])

    def draw(self, generator: np.random.Generator, t: Integers) -> Array:
        """States (count, k) for episodes that begin at the times (count,). All randomness is the generator's."""
        states = sampled_states(self._task.system, self._region, generator, len(t))
        if self._near:
            for row in np.flatnonzero(generator.random(len(t)) < _NEAR):
                following = self._ends[self._ends >= t[row]]
                if following.size:  # of the conditions that stand, one of those that end first
                    fulfil = self._near[generator.choice(np.flatnonzero(self._ends == following[0]))][1]
                    states[row] = fulfil[generator.integers(len(fulfil))]
        return states
