"""Where the episodes of a task begin: for the report, for the selection of checkpoints, in training, and elsewhere.

The sets share no start, so that no policy is reported from where it was trained or chosen.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from stlbench.contract import Array, System
from stlbench.errors import UsageError
from stlbench.task import starts
from stlbench.task.file import Protocol, TaskFile
from stlbench.task.region import Region

_REPORTED = 12031981
"""Seed of the report's random starts, and of nothing else."""


class StartSets(ABC):
    """The sets of starts of a task, each an array (count, s): states, s = n, or seeds, s = 1."""

    @abstractmethod
    def report_and_selection(self) -> tuple[Array, Array]:
        """Those behind the main score of the report, and those on which checkpoints are selected."""

    @abstractmethod
    def at_random(self, count: int) -> Array:
        """Those of the report's many random starts, the same for every method and seed of a task."""

    @abstractmethod
    def of_protocol(self, protocol: Protocol) -> Array:
        """Those of a further protocol of the task file."""

    @abstractmethod
    def of_training(self, generator: np.random.Generator, count: int) -> Array:
        """Where that many training episodes begin. All randomness is the generator's."""

    def of_exploring(self, generator: np.random.Generator, count: int) -> Array:
        """Where exploring episodes begin that begin elsewhere (`training.exploring.states`)."""
        raise UsageError("training.exploring.states needs a system, whose state can be set")


@dataclass(frozen=True)
class StateStarts(StartSets):
    """States of a system, from the regions of the task file."""

    file: TaskFile
    system: System

    @property
    def initial(self) -> Region:
        """Where the referee's starts lie, in the system's coordinates."""
        assert self.file.initial is not None
        return self.file.initial

    def report_and_selection(self) -> tuple[Array, Array]:
        """Two parts of one even sequence; see `starts.grid_apart`."""
        return starts.grid_apart(self.initial, self.file.starts, self.system.initial_states)

    def at_random(self, count: int) -> Array:
        """See `StartSets`."""
        return self._drawn(self.initial, np.random.default_rng(_REPORTED), count)

    def of_protocol(self, protocol: Protocol) -> Array:
        """An even grid of the protocol's region, or of the task's."""
        return self.system.initial_states(starts.grid(protocol.initial or self.initial, protocol.starts))

    def of_training(self, generator: np.random.Generator, count: int) -> Array:
        """See `StartSets`."""
        return self._drawn(self.file.training.starts or self.initial, generator, count)

    def of_exploring(self, generator: np.random.Generator, count: int) -> Array:
        """See `StartSets`."""
        exploring = self.file.training.exploring
        assert exploring is not None
        assert exploring.states is not None
        return self._drawn(exploring.states, generator, count)

    def _drawn(self, region: Region, generator: np.random.Generator, count: int) -> Array:
        return self.system.initial_states(starts.sample(region, generator, count))


_SELECTION, _RANDOM, _PROTOCOLS, _FRESH, _TRAINING, _END = 10**5, 2 * 10**5, 3 * 10**5, 10**6, 2**30, 2**31
"""Where the ranges of seeds begin; those of the report's grid begin at 0."""


@dataclass(frozen=True)
class SeedStarts(StartSets):
    """Seeds of a world whose state cannot be set. The sets are ranges of whole numbers, apart from each other.

    0 and up: the report; 100,000: selection; 200,000: the report's random starts; 300,000: protocols, all from the same
    seeds; from 1,000,000 below 2^30: `fresh`; from 2^30 below 2^31: training.
    """

    file: TaskFile

    def report_and_selection(self) -> tuple[Array, Array]:
        """The first seeds of two ranges."""
        return _seeds(0, self.file.starts), _seeds(_SELECTION, self.file.starts)

    def at_random(self, count: int) -> Array:
        """See `StartSets`."""
        return _seeds(_RANDOM, count)

    def of_protocol(self, protocol: Protocol) -> Array:
        """See `StartSets`."""
        return _seeds(_PROTOCOLS, protocol.starts)

    def of_training(self, generator: np.random.Generator, count: int) -> Array:
        """See `StartSets`."""
        return generator.integers(_TRAINING, _END, (count, 1)).astype(np.float64)

    def fresh(self, seed: int, count: int) -> Array:
        """Random ones for what comes after a study, such as a certificate, by a seed of the user's."""
        return np.random.default_rng(seed).integers(_FRESH, _TRAINING, (count, 1)).astype(np.float64)


def _seeds(first: int, count: int) -> Array:
    if count > _SELECTION:
        raise UsageError(f"starts are seeds, at most {_SELECTION} of one kind, got {count}")
    return np.arange(first, first + count, dtype=np.float64)[:, None]
