"""One cell, from its identity to its result: train, select, report. Runs in a worker process."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from stlbench.contract import Agent, Array, Arrays, Intractable, Policy, RewardMethod, StatePolicy, Unsuitable
from stlbench.errors import one_line
from stlbench.records import saved_policies, saved_traces
from stlbench.records.outputs import cell_files, inside
from stlbench.records.result import CurvePoint, Measurement, Planned, Result, StoredPolicies
from stlbench.records.saved_traces import Assessment
from stlbench.rollout.cost import refuse_dear
from stlbench.rollout.observing import observation_of
from stlbench.rollout.referee import Referee
from stlbench.rollout.worlds import make_world
from stlbench.study.cell import Cell
from stlbench.study.initial import arrays_of
from stlbench.study.tracks import Recipe
from stlbench.study.training import Checkpoint, Clock, train
from stlbench.task import Task, build_agent, build_method

_REWARDED = 16  # copies that are stepped to measure the time of a reward


def run_cell(cell: Cell, folder: Path | None = None) -> Result:
    """Train and score one cell; traces and policies are saved in the folder of results, if there is one.

    A method or agent that does not fit the task is a result, with its reason. Other errors of plugins are raised.
    """
    task = cell.load_task()
    try:
        method = build_method(task, cell.id.method)
        agent = build_agent(task, cell.id.agent)
        refuse_dear(task, method, agent, task.budget(cell.id.budget).steps)
        measured = measure(task, method, agent, cell, arrays_of(cell))
    except Intractable as reason:
        return cell.ended("intractable", one_line(reason))
    except Unsuitable as reason:
        return cell.ended("unsuitable", one_line(reason))
    numbers = measured.numbers if folder is None else _stored(measured, task, method, cell, folder)
    return cell.ended("done", measurement=numbers)


class Measured(NamedTuple):
    numbers: Measurement
    assessment: Assessment  # the selected policy's report
    selected: Policy | StatePolicy
    final: Policy | StatePolicy
    observation_size: int  # D; 0 where no environment was made


def _stored(measured: Measured, task: Task, method: RewardMethod, cell: Cell, folder: Path) -> Measurement:
    """Save traces and policies in a folder of results; the numbers, which say by what hashes policies are known."""
    traces = cell_files(folder, cell.id, cell.key).traces
    saved_traces.save(inside(traces, folder), measured.assessment, task.signals)
    path = cell_files(folder, cell.id, cell.key).policies
    digests = saved_policies.save(inside(path, folder), measured.selected, measured.final)
    if digests is None:
        return measured.numbers
    recipe = cell.recipe or Recipe()
    shown = observation_of(task, method, str(cell.id.method))
    stored = StoredPolicies(*digests, measured.observation_size, dict(recipe.agent), recipe.hold, shown)
    return replace(measured.numbers, policies=stored)


def measure(task: Task, method: RewardMethod, agent: Agent, cell: Cell, initial: Arrays | None = None) -> Measured:
    """Train, perhaps from the arrays of an earlier policy, and score the selected and the final policy."""
    whole = Clock()
    referee = Referee(task, method, task.budget(cell.id.budget).random_starts)
    trained = train(task, method, agent, cell, referee.glance, initial)
    selected, curve = _choose(referee, trained.checkpoints)
    assessment = referee.assess(selected.policy)
    last = assessment if selected.policy is trained.final else referee.assess(trained.final)
    reward_nanoseconds = reward_time(task, method)
    whole.pause()
    measurement = Measurement(
        selected=assessment.scores,
        final=last.scores,
        selected_steps=selected.steps,
        curve=curve,
        training_cpu_seconds=trained.clock.cpu,
        training_wall_seconds=trained.clock.wall,
        cpu_seconds=whole.cpu,
        wall_seconds=whole.wall,
        env_steps=trained.env_steps,
        reward_nanoseconds=reward_nanoseconds,
        inputs_added=method.input_size,
        planned=_planned(agent, selected.policy, assessment),
        extension=method.extension,
    )
    return Measured(measurement, assessment, selected.policy, trained.final, trained.observation_size)


def _planned(agent: Agent, policy: Policy | StatePolicy, assessment: Assessment) -> Planned | None:
    """What the policy of an agent that plans expects from the report's starts; None for one that learns."""
    if agent.plans is None:
        return None
    values = policy.value(assessment.states[:, 0]) if isinstance(policy, StatePolicy) else np.nan
    return Planned(agent.plans, float(np.mean(values)))


def _choose(referee: Referee, reported: Sequence[Checkpoint]) -> tuple[Checkpoint, tuple[CurvePoint, ...]]:
    choice = referee.choose([checkpoint.policy for checkpoint in reported])
    scores = zip(choice.satisfaction.tolist(), choice.robustness_mean.tolist(), choice.starts.tolist(), strict=True)
    curve = [CurvePoint(at.steps, at.cpu_seconds, *score) for at, score in zip(reported, scores, strict=True)]
    return reported[choice.best], tuple(curve)


def reward_time(task: Task, method: RewardMethod, rows: int = 1024, repeats: int = 5, rounds: int = 10) -> float:
    """CPU nanoseconds that the method's reward takes per step and copy, in a batch of `rows` under random actions.

    The least of `rounds`, each of `repeats` calls and far shorter than a time slice: whatever else the machine does can
    only make a round slower. Few copies are stepped, and their signals repeated to `rows`: to step a simulator as often
    would take longer.
    """
    generator, actions, world = np.random.default_rng(0), task.actions, make_world(task, _REWARDED)
    action = generator.uniform(actions.low, actions.high, (_REWARDED, len(actions.names)))
    world.restart(np.arange(_REWARDED), task.starts.of_training(generator, _REWARDED))
    repeated, t = np.arange(rows) % _REWARDED, np.zeros(rows, dtype=np.int64)
    signals = world.advance(action, task.file.hold)[:, repeated]
    memory = method.initial_memory(signals[0], t)
    along = partial(method.along, signals, action[repeated], t)
    along(memory)
    least = min(_repeated(along, memory, repeats) for _ in range(rounds))
    return least / (rows * repeats * task.file.hold)


def _repeated(along: Callable[[Array], tuple[Array, Array]], memory: Array, repeats: int) -> int:
    """CPU nanoseconds of so many calls, each with the memory that the one before it left."""
    begin = time.process_time_ns()
    for _ in range(repeats):
        _, memory = along(memory)
    return time.process_time_ns() - begin
