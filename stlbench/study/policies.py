"""Stored policies: loaded with their task and method, and simulated again from any start, also in front of a camera."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, cast

import numpy as np

from stlbench.contract import Agent, Array, Arrays, GymTask, Intractable, Policy, RewardMethod, Unsuitable
from stlbench.contract.presentation import Pixels
from stlbench.errors import UsageError, cause
from stlbench.records.array_files import Film, Which, read_policy
from stlbench.records.identity import CellId
from stlbench.records.result import Result, StoredPolicies
from stlbench.registry import plugins
from stlbench.simulation import referee
from stlbench.simulation.environment import Simulator
from stlbench.simulation.referee import Recording
from stlbench.simulation.worlds import observation_of
from stlbench.study.cell import Recipe, on_track
from stlbench.task import build_method
from stlbench.task.starts import StateStarts
from stlbench.task.task import Task, load_task


class Reenactment:
    """Pictures of each copy in the order of time. An environment's state cannot be set, so the episode is repeated."""

    def __init__(self, task: Task, method: RewardMethod, policy: Policy, begun: Array) -> None:
        self._policy, self._simulator = policy, Simulator(task, method, rewarded=False, drawn=True)
        self._simulator.reset(begun)
        self._samples = [self._simulator.signals[:, None].copy()]

    def __call__(self, sample: int) -> Sequence[Pixels]:
        """The pictures at the last decision before a sample, which may not decrease; `RuntimeError` without any."""
        simulator = self._simulator
        while simulator.t[0] + simulator.hold <= sample:
            self._samples.append(simulator.advance(self._policy.act(simulator.observe())).samples)
        pictures = simulator.world.frames()
        if pictures is None:
            raise RuntimeError("the simulation has no picture of itself")
        return pictures

    def repeats(self, traces: Array) -> bool:
        """Whether the samples up to now are those of traces (n, T + 1, k); after an early end these may be NaN."""
        lived = np.concatenate(self._samples, axis=1)
        recorded = traces[:, : lived.shape[1]]
        return bool(np.allclose(np.where(np.isnan(recorded), lived, recorded), lived))


class LoadedPolicy(NamedTuple):
    """The referee needs this to let a stored policy act: `record(kept.task, kept.method, kept.policy, states)`."""

    task: Task  # as the cell's track and recipe have it
    method: RewardMethod  # gives the policy the inputs that it was trained with
    policy: Policy


def load_policy(folder: Path, result: Result, which: Which = "selected", on: Task | None = None) -> LoadedPolicy:
    """The stored policy of a cell; it acts as it did when it was scored, bit for bit.

    The result has what matters of a tuned recipe. A library that the agent trains with is needed only if its policies
    use it. `on` is another task than the cell's own, with the same observation and actions. Raises `UsageError` if no
    policy is stored, or it differs from the record, or its plugins are missing or show and take other things now.
    """
    arrays, name = read_policy(folder, result, which), result.id.name
    assert result.measured.policies is not None
    stored, cell = result.measured.policies, result.id
    task = own_task(cell, stored) if on is None else on
    try:
        method = build_method(task, cell.method)
        policy = _restored(cell.agent.name, arrays, task)
    except (Intractable, Unsuitable) as error:
        raise UsageError(f"{name}: its policy cannot be used: {error}") from error
    _check(name, task, method, stored, cell)
    return LoadedPolicy(task, method, policy)


def own_task(cell: CellId, stored: StoredPolicies) -> Task:
    """The task of a cell, as its track and recipe have it. Raises `UsageError` where it is not installed."""
    recipe = Recipe(stored.agent, stored.hold) if cell.track == "tuned" else None
    return on_track(load_task(cell.task), cell.agent, cell.track, recipe)


def _restored(agent: str, arrays: Arrays, task: Task) -> Policy:
    plugin = plugins.find("agents", agent)
    kind = cast(type[Agent], plugin.load())
    try:
        policy = kind.restore(arrays, task.actions)
        if not isinstance(policy, Policy):
            raise TypeError(f"restore gives {type(policy).__name__}, the contract says a policy")
        return policy
    except Unsuitable:
        raise
    except Exception as error:
        raise Unsuitable(f"{plugin} cannot restore it: {cause(error)}") from error


def _check(name: str, task: Task, method: RewardMethod, stored: StoredPolicies, cell: CellId) -> None:
    """Networks do not check what they are given; some would read what lies beside it in memory."""
    shown = observation_of(task, method, str(cell.method))
    if shown.total != stored.observation_size:
        rule = f"acts on {stored.observation_size} numbers, and task {task.name} shows {shown.total}"
        raise UsageError(f"{name}: its policy {rule}; it is another task, or one was changed since it was trained")
    if stored.observation is not None:
        stored.observation.check(name, shown)
    elif task.choice != cell.task:
        own = own_task(cell, stored)
        observation_of(own, build_method(own, cell.method), str(cell.method)).check(name, shown)


@dataclass(frozen=True)
class Start:
    """Which one: of the report's, or anywhere. All of the report's where neither is said."""

    index: int | None = None  # of the report's grid, counted from 0
    point: tuple[float, ...] | None = None
    """In the coordinates of the task's `initial` box; of an environment whose starts are seeds, one of them."""


EVERY = Start()  # all starts of the report's grid


class Replay(NamedTuple):
    """Traces of a policy, and what the referee says of them."""

    task: Task
    method: RewardMethod | None  # None for recorded traces, where nothing acted again
    recording: Recording
    robustness: tuple[float, ...]  # from each start


def parse_start(text: str) -> tuple[float, ...]:
    """The numbers of "0.3,1.2". Raises `UsageError` where one is none."""
    try:
        point = tuple(float(part) for part in text.split(","))
    except ValueError:
        point = ()
    if not point or not all(map(math.isfinite, point)):
        raise UsageError(f"--start {text}: numbers separated by commas are expected, as in 0.3,1.2")
    return point


def replay(folder: Path, result: Result, which: Which = "selected", start: Start = EVERY) -> Replay:
    """Let a cell's stored policy act again. Raises `UsageError` as `load_policy`, or if the task has no such start."""
    task, method, policy = load_policy(folder, result, which)
    visited = list[Array]()
    traces = referee.record(task, method, policy, _begun(task, start), visited).traces
    robustness = referee.score(task, traces).robustness
    extremes = np.array([np.argmax(robustness), np.argmin(robustness)])[: len(traces)]
    states = np.stack(visited, axis=1)
    return Replay(task, method, Recording(traces, 1, Film(extremes, states[extremes])), robustness)


def reenact(folder: Path, result: Result, which: Which, start: Start, film: Film) -> Reenactment:
    """Let a cell's stored policy act before a camera, from the starts of a film.

    Raises `UsageError` as `replay`, or if the task's environment has no pictures.
    """
    task, method, policy = load_policy(folder, result, which)
    if isinstance(task.dynamics, GymTask) and task.source.undrawn:
        raise UsageError(task.source.undrawn)
    return Reenactment(task, method, policy, _begun(task, start)[film.starts])


def _begun(task: Task, start: Start) -> Array:
    if start.point is not None:
        return _at(task, start.point)
    reported = task.starts.report_and_selection()[0]
    if start.index is None:
        return reported
    if start.index >= len(reported):
        raise UsageError(f"the report of {task.name} has starts 0 to {len(reported) - 1}, got {start.index}")
    return reported[[start.index]]


def _at(task: Task, point: tuple[float, ...]) -> Array:
    starts = task.starts
    if not isinstance(starts, StateStarts):
        if len(point) != 1 or point[0] < 0 or point[0] != int(point[0]):
            raise UsageError(f"a start of {task.name} is a seed, a whole number from 0 on")
        return np.array([point])
    names = tuple(starts.initial.box)
    if len(point) != len(names):
        raise UsageError(f"a start of {task.name} has {len(names)} numbers, {', '.join(names)}; got {len(point)}")
    return starts.system.initial_states(np.array([point]))
