"""Suites: many tasks that are made from their names. Import them from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from stlbench.contract.arrays import Integers
from stlbench.contract.system import System


class SuiteTask(NamedTuple):
    """One task of a suite: what a package with a task has."""

    system: type[System]
    file: str
    """The text of its `task.yaml`."""


class SuiteScores(NamedTuple):
    """The results of methods on one task of a suite."""

    formula: str
    """Its intervals are in steps."""
    scores: Mapping[str, Sequence[float]]
    """Method -> for each seed the robustness, 0 at random and 1 the best known; only of methods that fit."""


class Suite(ABC):
    """Tasks that are made from their names, such as `unicycle/sequence/7`.

    The same name gives the same task for ever; tasks that differ belong to a suite of another name. A user writes
    `suite:unicycle/sequence/7`, with the suite's own name before the colon. In results the task has the name
    `suite-unicycle-sequence-7`.
    """

    @property
    @abstractmethod
    def names(self) -> Sequence[str]:
        """The names of all tasks: parts of a-z, 0-9 and -, with slashes between them."""

    @property
    @abstractmethod
    def splits(self) -> Mapping[str, Sequence[str]]:
        """Names of sets of tasks, such as `dev`, and the names of their tasks."""

    @abstractmethod
    def task(self, name: str) -> SuiteTask:
        """The task of one of the `names`."""

    # ------------------------------------------------------------------ additions

    def groups(self, name: str) -> Mapping[str, str]:
        """The groups of a task, such as its system and its template: kind of group -> the task's group.

        All tasks have the same kinds. Reports say for each group how methods do on its tasks. Tasks with a group count
        as a sample: intervals are for all tasks that the suite could draw.
        """
        return {}

    def witness(self, name: str) -> Integers | None:
        """Actions from each of the report's starts that show what is possible; None where nothing is known.

        Indices of the grid of actions, (starts, decisions).
        """
        return None

    def scores(self) -> Sequence[SuiteScores]:
        """The results of methods on its tasks. `stlbench advise` judges by them which method suits a formula."""
        return ()
