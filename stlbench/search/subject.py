"""What is searched for failure: a policy or a hand controller that acts in its task."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

from stlbench import stl
from stlbench.contract import Array, Policy, RewardMethod, StatePolicy, System, Truth
from stlbench.errors import UsageError
from stlbench.rollout import controller, referee
from stlbench.rollout.early_ends import judge
from stlbench.task.task import Task

__all__ = ["Played", "Subject", "of_controller", "of_policy"]

_NUMBERS = 2**22
"""The most numbers in the traces that are simulated at a time."""
_ROWS, _COPIES = 1024, 64
"""The most episodes that are simulated at a time, of a system, and of what has no settable state: more are hardly
faster."""


class Played(NamedTuple):
    """What came of N episodes."""

    traces: Array
    """(N, T + 1, k); NaN after an early end, where that means more than that the last sample stays."""
    robustness: Array
    """(N,), of the task's formula; after an early end the least that is possible."""
    satisfied: Truth
    """(N,): by every continuation."""


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
        most = _ROWS if isinstance(self.task.dynamics, System) else _COPIES
        return max(1, min(most, _NUMBERS // ((self.task.file.steps + 1) * len(self.task.signals))))

    def play(self, starts: Array) -> Played:
        """Act from each of the starts (N, n). Raises `UsageError` where the formula has no value on a trace."""
        task, traces = self.task, self.record(starts)
        try:
            found = judge(task.formula, traces, task.specification, task.file.terminated)
            return Played(traces, found.robustness[:, 0], found.satisfied[:, 0])
        except stl.UndefinedError as error:
            raise UsageError(f"{self.name}: {error}") from error


def of_policy(
    name: str, label: tuple[str, ...], task: Task, method: RewardMethod, policy: Policy | StatePolicy
) -> Subject:
    """A policy with the method that gives it its inputs."""
    return Subject(name, label, task, partial(referee.record, task, method, policy))


def of_controller(task: Task) -> Subject:
    """The task's controller by hand. Raises `UsageError` where it has none."""

    def record(states: Array) -> Array:
        traces = controller.record(task, states)
        assert traces is not None
        return traces

    if controller.record(task, task.starts.report_and_selection()[0][:1]) is None:
        raise UsageError(f"task {task.name} has no controller by hand")
    return Subject(f"{task.name}, by hand", (task.name, "by-hand"), task, record)
