"""What is searched for failure: a policy or a hand controller that acts in its task."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Policy, RewardMethod, StatePolicy, Truth
from stlbench.errors import UsageError, cause
from stlbench.rollout import controller, referee
from stlbench.rollout.early_ends import judge
from stlbench.rollout.referee import at_once
from stlbench.search.space import space_of
from stlbench.task.task import Task

Verdict = Literal["violated", "open", "satisfied"]
"""Of one episode; open where it ended early, and some continuations satisfy."""
VERDICTS: tuple[Verdict, ...] = ("violated", "open", "satisfied")
"""From the worst to the best."""

_NUMBERS = 2**22
"""The most numbers in the traces that are simulated at a time."""


class Unsearchable(UsageError):
    """A subject that cannot be searched: others beside it still are."""


@contextmanager
def foreign(name: str) -> Iterator[None]:
    """Where code of others acts for a subject of that name.

    What it raises, `SystemExit` too, becomes `Unsearchable`: "NAME cannot be tried: ValueError: no such luck". What is
    a `UsageError` stays as it is.
    """
    try:
        yield
    except UsageError:
        raise
    except (Exception, SystemExit) as error:
        raise Unsearchable(f"{name} cannot be tried: {cause(error)}") from error


class Played(NamedTuple):
    """What came of N episodes."""

    traces: Array
    """(N, T + 1, k); NaN after an early end, where that means more than that the last sample stays."""
    robustness: Array
    """(N,), of the task's formula; after an early end the least that is possible."""
    satisfied: Truth
    """(N,): by every continuation."""
    possible: Truth
    """(N,): satisfied by some continuation; of a complete episode the same as `satisfied`."""

    @property
    def verdicts(self) -> Integers:
        """(N,): places in `VERDICTS`."""
        return self.satisfied.astype(np.int64) + self.possible


@dataclass(frozen=True)
class Subject:
    """Something that acts in a task, from any start to the end of the episode."""

    name: str
    """For people: hold-disc/funnel/dqn/0."""
    label: tuple[str, ...]
    """The parts of its files' names."""
    task: Task
    record: Callable[[Array], Array]
    """From starts (N, n), as the simulator resets to them, to traces (N, T + 1, k) of the task's signals."""

    @property
    def rows(self) -> int:
        """How many episodes are simulated at a time, at most."""
        return max(1, min(at_once(self.task), _NUMBERS // ((self.task.file.steps + 1) * len(self.task.signals))))

    def play(self, points: Array) -> Played:
        """Act from each of the points (N, n) of the task's space.

        Raises:
            Unsearchable: what acts, or the task, fails or breaks its contract; the formula has no value on a trace.
        """
        task = self.task
        try:
            with foreign(self.name):
                traces = self.record(space_of(task).starts(points))
            found = judge(task.formula, traces, task.specification, task.file.terminated)
        except Unsearchable:
            raise
        except (UsageError, stl.UndefinedError) as error:
            raise Unsearchable(f"{self.name} cannot be tried: {error}") from error
        return Played(traces, found.robustness[:, 0], found.satisfied[:, 0], found.satisfied[:, 1])


def of_policy(
    name: str, label: tuple[str, ...], task: Task, method: RewardMethod, policy: Policy | StatePolicy
) -> Subject:
    """A policy with the method that gives it its inputs."""
    return Subject(name, label, task, partial(_traces, task, method, policy))


def _traces(task: Task, method: RewardMethod, policy: Policy | StatePolicy, starts: Array) -> Array:
    return referee.record(task, method, policy, starts).traces


def of_controller(task: Task) -> Subject:
    """The task's controller by hand. Raises `UsageError` where it has none, or where it fails."""
    name = f"{task.name}, by hand"

    def record(states: Array) -> Array:
        found = controller.record(task, states)
        assert found is not None
        return found.traces

    with foreign(name):
        tried = controller.record(task, task.starts.report_and_selection()[0][:1])
    if tried is None:
        raise UsageError(f"task {task.name} has no controller by hand")
    return Subject(name, (task.name, "by-hand"), task, record)
