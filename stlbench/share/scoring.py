"""The score of a policy that stlbench did not train: by the same referee, from the same starts."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from stlbench.contract import (
    Array,
    GymTask,
    Integers,
    Intractable,
    RewardMethod,
    System,
    Unsuitable,
)
from stlbench.errors import UsageError
from stlbench.records.observation import Observation
from stlbench.records.result import MAIN, Measurement, Score
from stlbench.registry.choices import Choice
from stlbench.rollout import referee
from stlbench.rollout.controller import Unpaid
from stlbench.rollout.observing import observation_of
from stlbench.share.actions import OnObservation, OnState, numbers_of, read_actions
from stlbench.share.onnx import load_onnx
from stlbench.share.sb3 import load_sb3
from stlbench.share.source import Source, load_function
from stlbench.share.torch_files import load_state_dict, load_torchscript
from stlbench.share.traces import from_the_reports_starts, load_traces
from stlbench.task import Task, build_method

if TYPE_CHECKING:
    from stlbench.task.gym_spaces import Observed

UNKNOWN = Choice("unknown")
"""In the place of a method: nobody said which reward the policy was trained by, and it is shown no inputs of one."""
On = Literal["observation", "state", "environment"]


@dataclass(frozen=True)
class Shown:
    """What a policy is shown."""

    on: On | None = None
    """What agents of stlbench see, (N, D); of a system the states (N, n), and for a function the step counts t (N,); of
    a task on an environment its own observations (N, d), as they are. None is the first, unless a file contradicts
    it."""
    method: Choice = UNKNOWN  # the reward method whose inputs are the end of the observation


class Scored(NamedTuple):
    measurement: Measurement  # with what is known of it: scores, and nothing of a training
    traces: Array  # (N, T + 1, k): those behind the main score
    states: Array | None  # (N, decisions + 1, n): the states behind them; None of recorded traces
    starts: str  # whose they are, in words
    observation: str = ""  # what the policy was shown, in words; empty of recorded traces
    moved: str = ""  # how many of its actions were moved to the task's grid, and how far; empty where none was


def score(task: Task, source: Source, shown: Shown, random_starts: int) -> Scored:
    """Score a policy, or recorded traces, by a task's formula and protocols.

    There are `random_starts` beside the grid, as the task's budget says. Raises `UsageError` if the policy cannot be
    read, is for another observation, fails, or gives no actions of the task; or if traces are not of the task.
    """
    begun = time.process_time(), time.perf_counter()
    if source.kind == "traces":
        if shown != Shown():
            raise UsageError(f"{source.text} has traces, which are shown nothing; leave --method and --on out")
        traces, lasted = load_traces(source.path, task)
        try:
            scores = {MAIN: referee.score(task, traces, lasted=lasted)}
        except ValueError as error:
            raise UsageError(f"{source.text}: {error}") from error
        starts = "the report's starts" if from_the_reports_starts(traces, task) else "starts of its own"
        return Scored(_measured(scores, begun), traces, None, starts)
    played = play(task, source, shown)
    assessment = referee.Referee(task, played.method, random_starts).assess(played.policy)
    measured = _measured(assessment.scores, begun, played.method.input_size)
    moved = played.policy.moved.text({name: axis.unit for name, axis in task.file.actions.items()}, task.actions.names)
    return Scored(measured, assessment.traces, assessment.states, "the report's starts", played.observation, moved)


class Played(NamedTuple):
    """What the referee needs to let a policy act."""

    method: RewardMethod
    policy: OnObservation | OnState
    observation: str  # what it is shown, in words


def play(task: Task, source: Source, shown: Shown) -> Played:
    method = _method(task, shown.method)
    table = None if source.table is None else read_actions(Path(source.table), task.actions)
    if shown.on == "state":
        states = _states(task)
        act = _on_state(task, source, table, states, shown)
        step = " and the step" if source.kind == "function" else ""
        return Played(method, OnState(act, task.actions, source.text, table), f"{states}{step}")
    observation = observation_of(task, method, "" if shown.method == UNKNOWN else str(shown.method))
    if shown.on == "environment":
        observed, observation = _observed(task, method), observation.unscaled
        own = _function(task, source, table, observation, shown)
        size = observed.size
        policy = OnObservation(lambda seen: own(observed.own(seen[:, :size])), task.actions, source.text, table)
    else:
        policy = OnObservation(_function(task, source, table, observation, shown), task.actions, source.text, table)
    return Played(method, policy, str(observation))


def _method(task: Task, choice: Choice) -> RewardMethod:
    if choice == UNKNOWN:
        return Unpaid(task.specification)
    try:
        return build_method(task, choice)
    except (Intractable, Unsuitable) as error:
        raise UsageError(f"method {choice} on task {task.name}: {error}") from error


def _states(task: Task) -> Observation:
    if not isinstance(task.dynamics, System):
        raise UsageError(f"--on state: task {task.name} is no system, its states are not to be had")
    names = task.dynamics.state
    return Observation(len(names), names, task=task.name).unscaled


def _on_state(
    task: Task, source: Source, table: Array | None, states: Observation, shown: Shown
) -> Callable[[Array, Integers], Any]:
    """A function of states and steps; a network is given the states alone."""
    if source.kind == "function":
        return load_function(source.text)
    network = _function(task, source, table, states, shown)
    return lambda state, t: network(state)


def _observed(task: Task, method: RewardMethod) -> Observed:
    """The observation of a task's environment, which has no inputs of a method."""
    if not isinstance(task.dynamics, GymTask):
        raise UsageError(f"--on environment: task {task.name} is on no environment of Gymnasium")
    if method.input_size:
        raise UsageError("--on environment: what it shows has no inputs of a method; leave --method out")
    return task.source.observed


def _function(
    task: Task, source: Source, table: Array | None, observation: Observation, shown: Shown
) -> Callable[[Array], Any]:
    actions = task.actions if table is None else numbers_of(table)
    match source.kind:
        case "function":
            return load_function(source.text)
        case "sb3":
            return load_sb3(source.path, actions, observation, declared=shown.on is not None)
        case "torch" if source.architecture is not None:
            return load_state_dict(source.path, source.architecture, observation.total)
        case "torch":
            return load_torchscript(source.path)
        case _:
            return load_onnx(source.path, observation)


def _measured(scores: Mapping[str, Score], begun: tuple[float, float], inputs: int = 0) -> Measurement:
    """Nothing of it is about training; the seconds are those of scoring."""
    cpu, wall = time.process_time() - begun[0], time.perf_counter() - begun[1]
    return Measurement(
        selected=scores,
        final=scores,
        selected_steps=0,
        curve=(),
        training_cpu_seconds=0.0,
        training_wall_seconds=0.0,
        cpu_seconds=cpu,
        wall_seconds=wall,
        env_steps=0,
        reward_nanoseconds=0.0,
        inputs_added=inputs,
    )
