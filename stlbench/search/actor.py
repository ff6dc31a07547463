"""The subject of a search: a policy or a controller by hand that acts in its task, from any start of a space of starts.

Each of its points (N, n) stands for a start (N, s) of the simulator.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract import Array, Integers, Policy, RewardMethod, StatePolicy, System, Truth
from stlbench.errors import UsageError, cause
from stlbench.records.array_files import Which
from stlbench.records.result import Result
from stlbench.simulation import baselines, referee
from stlbench.simulation.referee import Episodes, at_once
from stlbench.simulation.verdicts import judge
from stlbench.study.policies import load_policy
from stlbench.task import starts
from stlbench.task.entry import Region
from stlbench.task.starts import SeedStarts, StateStarts
from stlbench.task.task import Task


def space_of(task: Task) -> Box | Seeds:
    if isinstance(task.starts, StateStarts):
        return Box(task.starts.initial, task.system)
    return Seeds(task.starts)


@dataclass(frozen=True)
class Seeds:
    """Seeds, other than the seeds of training, selection and report. An optimiser cannot search them."""

    sets: SeedStarts
    single = False
    names = ("seed",)

    def draw(self, generator: np.random.Generator, count: int) -> Array:
        return self.sets.fresh(int(generator.integers(2**31)), count)

    def starts(self, points: Array) -> Array:
        return points


@dataclass(frozen=True)
class Box:
    """A region of a system's initial states; a unit cube spans its `size` free coordinates."""

    region: Region
    system: System

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.region.box)

    @property
    def single(self) -> bool:
        return self.size == 0

    @cached_property
    def free(self) -> Integers:
        return np.flatnonzero(self.region.low < self.region.high)

    @property
    def size(self) -> int:
        return len(self.free)

    def points(self, unit: Array) -> Array:
        """Points (N, n) of the box from the unit cube (N, size); they may break the region's condition."""
        low, high = self.region.low, self.region.high
        points = np.tile(low, (len(unit), 1))
        points[:, self.free] += np.clip(unit, 0.0, 1.0) * (high - low)[self.free]
        return np.minimum(points, high)  # low + (high - low) may round to more

    def inside(self, points: Array) -> Truth:
        where = self.region.where
        if where is None:
            return np.ones(len(points), dtype=np.bool_)
        return np.asarray(stl.holds(where, self.names)(points))

    def violation(self, points: Array) -> Array:
        """How far points (N, n) that are not inside break the condition, (N,), at least 0."""
        assert self.region.where is not None
        with np.errstate(all="ignore"):
            return np.nan_to_num(np.maximum(-stl.margin(self.region.where, self.names)(points), 0.0))

    def draw(self, generator: np.random.Generator, count: int) -> Array:
        return starts.sample(self.region, generator, count)

    def starts(self, points: Array) -> Array:
        return self.system.initial_states(points)


Verdict = Literal["violated", "open", "satisfied"]
"""The verdict on one episode; open if it ended early and some continuations satisfy."""
VERDICTS: tuple[Verdict, ...] = ("violated", "open", "satisfied")  # the worst first
_NUMBERS = 2**22  # the most numbers in the traces that are simulated at once: 32 MiB


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
    lasted: Integers  # (N,): as that of `Episodes`

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
    record: Callable[[Array], Episodes]
    """A function of starts (N, n), as the simulator resets to them."""

    @property
    def rows(self) -> int:
        return max(1, min(at_once(self.task), _NUMBERS // ((self.task.file.steps + 1) * len(self.task.signals))))

    def play(self, points: Array) -> Played:
        """Act from each of the points (N, n) of the task's space. Raises `Unsearchable` where that fails."""
        task = self.task
        try:
            with foreign(self.name):
                traces, lasted = self.record(space_of(task).starts(points))
            judged = judge(task.formula, traces, task.specification, task.file.terminated)
        except Unsearchable:
            raise
        except (UsageError, stl.UndefinedError) as error:
            raise Unsearchable(f"{self.name} cannot be tried: {error}") from error
        return Played(traces, judged.robustness[:, 0], judged.satisfied[:, 0], judged.satisfied[:, 1], lasted)


def of_policy(
    name: str, label: tuple[str, ...], task: Task, method: RewardMethod, policy: Policy | StatePolicy
) -> Actor:
    return Actor(name, label, task, lambda starts: referee.record(task, method, policy, starts))


def of_cell(folder: Path, result: Result, which: Which = "selected") -> Actor:
    """The stored policy of a cell in a folder of results."""
    last = ["final"] if which == "final" else []
    name, label = ", ".join([result.id.name, *last]), (*result.id.name.split("/"), result.id.budget, *last)
    with foreign(name):
        loaded = load_policy(folder, result, which)
    return of_policy(name, label, loaded.task, loaded.method, loaded.policy)


def of_controller(task: Task) -> Actor:
    name = f"{task.name}, by hand"

    def record(states: Array) -> Episodes:
        episodes = baselines.record_controller(task, states)
        assert episodes is not None
        return episodes

    with foreign(name):
        first = baselines.record_controller(task, task.starts.report_and_selection()[0][:1])
    if first is None:
        raise UsageError(f"task {task.name} has no controller by hand")
    return Actor(name, (task.name, "by-hand"), task, record)
