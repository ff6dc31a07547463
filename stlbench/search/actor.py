"""A policy or a controller by hand that acts in its task, from any start."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Policy, RewardMethod, StatePolicy, Truth
from stlbench.errors import UsageError, cause
from stlbench.records.result import Result
from stlbench.records.saved_policies import Which
from stlbench.rollout import controller, referee
from stlbench.rollout.early_ends import judge
from stlbench.rollout.referee import at_once
from stlbench.search.space import space_of
from stlbench.study.policies import load_policy
from stlbench.task.task import Task

Verdict = Literal["violated", "open", "satisfied"]
"""The verdict on one episode; open if it ended early and some continuations satisfy."""
VERDICTS: tuple[Verdict, ...] = ("violated", "open", "satisfied")  # the worst first
_NUMBERS = 2**22  # the most numbers in the traces that are simulated at once


class Unsearchable(UsageError):
    """An actor that cannot be tried; a command goes on with the next one."""


@contextmanager
def foreign(name: str) -> Iterator[None]:
    """Turn exceptions of other people's code, `SystemExit` too, into `Unsearchable`: "NAME cannot be tried: ..."."""
    try:
        yield
    except UsageError:
        raise
    except (Exception, SystemExit) as error:
        raise Unsearchable(f"{name} cannot be tried: {cause(error)}") from error


class Played(NamedTuple):
    """N episodes and their verdicts."""

    traces: Array  # (N, T + 1, k); after an early end NaN, or the last sample if the task's `terminated` is hold
    robustness: Array  # (N,), of the task's formula; after an early end the least that any continuation has
    satisfied: Truth  # (N,): whether every continuation satisfies
    possible: Truth  # (N,): whether some continuation satisfies; of a complete episode the same as `satisfied`

    @property
    def verdicts(self) -> Integers:
        """(N,): indices into `VERDICTS`."""
        return self.satisfied.astype(np.int64) + self.possible


@dataclass(frozen=True)
class Actor:
    """Something that acts in a task, from any start to the end of the episode."""

    name: str  # for messages: hold-disc/funnel/dqn/0
    label: tuple[str, ...]  # the parts of its files' names
    task: Task
    record: Callable[[Array], Array]
    """A function of starts (N, n), as the simulator resets to them, to traces (N, T + 1, k) of the task's signals."""

    @property
    def rows(self) -> int:
        return max(1, min(at_once(self.task), _NUMBERS // ((self.task.file.steps + 1) * len(self.task.signals))))

    def play(self, points: Array) -> Played:
        """Act from each of the points (N, n) of the task's space. Raises `Unsearchable` where that fails."""
        task = self.task
        try:
            with foreign(self.name):
                traces = self.record(space_of(task).starts(points))
            judged = judge(task.formula, traces, task.specification, task.file.terminated)
        except Unsearchable:
            raise
        except (UsageError, stl.UndefinedError) as error:
            raise Unsearchable(f"{self.name} cannot be tried: {error}") from error
        return Played(traces, judged.robustness[:, 0], judged.satisfied[:, 0], judged.satisfied[:, 1])


def of_policy(
    name: str, label: tuple[str, ...], task: Task, method: RewardMethod, policy: Policy | StatePolicy
) -> Actor:
    return Actor(name, label, task, lambda starts: referee.record(task, method, policy, starts).traces)


def of_cell(folder: Path, result: Result, which: Which = "selected") -> Actor:
    """The stored policy of a cell in a folder of results."""
    last = ["final"] if which == "final" else []
    name, label = ", ".join([result.id.name, *last]), (*result.id.name.split("/"), result.id.budget, *last)
    with foreign(name):
        loaded = load_policy(folder, result, which)
    return of_policy(name, label, loaded.task, loaded.method, loaded.policy)


def of_controller(task: Task) -> Actor:
    name = f"{task.name}, by hand"

    def record(states: Array) -> Array:
        episodes = controller.record(task, states)
        assert episodes is not None
        return episodes.traces

    with foreign(name):
        first = controller.record(task, task.starts.report_and_selection()[0][:1])
    if first is None:
        raise UsageError(f"task {task.name} has no controller by hand")
    return Actor(name, (task.name, "by-hand"), task, record)
