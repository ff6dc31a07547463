"""One cell, from its identity to its result: train by the clock and within its budget, select, report. Runs in a
worker process.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from numbers import Integral
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from stlbench import contract
from stlbench.errors import one_line
from stlbench.records import array_files
from stlbench.records.array_files import Assessment
from stlbench.records.result import CurvePoint, Measurement, Planned, Result, StoredPolicies
from stlbench.records.result_files import cell_files, inside
from stlbench.registry.breaches import breach
from stlbench.simulation.environment import BatchEnvironment, model_of
from stlbench.simulation.referee import Referee
from stlbench.simulation.rehearsal import rehearse
from stlbench.simulation.worlds import make_world, observation_of
from stlbench.study.cell import Cell, Recipe, derive_seed
from stlbench.study.fitting import refuse_dear
from stlbench.study.initial import Stored, arrays_of, subject
from stlbench.task import build_agent, build_method
from stlbench.task.task import Task


@dataclass
class Clock:
    """CPU and wall seconds, without the spans during which it is paused."""

    cpu: float = 0.0
    wall: float = 0.0
    _since: tuple[float, float] = field(default_factory=lambda: (time.process_time(), time.perf_counter()))

    def pause(self) -> None:
        self.cpu += time.process_time() - self._since[0]
        self.wall += time.perf_counter() - self._since[1]

    def go_on(self) -> None:
        self._since = (time.process_time(), time.perf_counter())


class Checkpoint(NamedTuple):
    policy: contract.Policy | contract.StatePolicy
    steps: int
    cpu_seconds: float  # of training so far


class Trained(NamedTuple):
    final: contract.Policy | contract.StatePolicy
    checkpoints: list[Checkpoint]  # at least one: the final policy of an agent that reported none
    env_steps: int
    clock: Clock
    observation_size: int
    kept: contract.Arrays  # none unless the budget says so, and the agent gives them


def train(
    task: Task,
    method: contract.RewardMethod,
    agent: contract.Agent,
    cell: Cell,
    score: Callable[[contract.Policy | contract.StatePolicy], tuple[float, float]],
    begun: Stored | None = None,
) -> Trained:
    """Rehearse, unless the agent plans, and train by the clock.

    Raises `RuntimeError` if the agent takes more steps than its budget, reports more than it took, takes none, or gives
    no policy.
    """
    used: list[CountedEnvironment] = []
    reported: list[Checkpoint] = []
    budget, clock = task.budget(cell.id.budget), Clock()
    meter = StepCounter(str(cell.id.agent))
    patience = None if budget.patience is None else Patience(budget.patience)

    def report(policy: contract.Policy | contract.StatePolicy, steps: int) -> bool:
        clock.pause()
        meter.check(policy, steps)
        reported.append(Checkpoint(policy, steps, clock.cpu))
        enough = patience is not None and patience.ends(*score(policy))
        late = budget.seconds is not None and clock.wall >= budget.seconds
        clock.go_on()
        return enough or late

    def make(count: int) -> CountedEnvironment:
        meter.check_count(count)
        used.append(CountedEnvironment(task, method, count, derive_seed(plugin, "initial states", seed), meter))
        return used[-1]

    plugin, seed = task.choice.name, cell.id.seed
    random = derive_seed(plugin, cell.id.agent.name, "training", seed)
    kept, training = dict[str, Any](), contract.Training(make, budget.steps, random, report, budget.checkpoints)
    if begun is not None:
        training = replace(training, initial=begun.policy, earlier=begun.training or None)
    if agent.plans is not None:
        training = replace(training, model=model_of(task, method))
    else:
        rehearse(agent, training, task.file.hold)
    meter.begin(budget.steps)
    clock.go_on()
    final = agent.train(replace(training, keep=kept.update) if budget.resumable else training)
    clock.pause()
    meter.check(final, meter.taken)
    if agent.trains and agent.plans is None:
        meter.check_trained()
    taken = meter.taken
    size = max((environment.observation_size for environment in used), default=0)
    return Trained(final, reported or [Checkpoint(final, taken, clock.cpu)], taken, clock, size, kept)


@dataclass
class Patience:
    """Ends a training that does not improve any more (`Budget.patience`)."""

    checkpoints: int  # that may pass without a better one
    best: float | None = None  # largest mean robustness of checkpoints that satisfy from all starts
    since: int = 0  # checkpoints after the best one

    def ends(self, satisfaction: float, robustness: float) -> bool:
        """Note a checkpoint's scores; whether the last checkpoints were no better than one before, and it satisfies.

        The training ends with this policy, so it should be one of the good ones.
        """
        if satisfaction == 1 and (self.best is None or robustness > self.best + 0.01 * abs(self.best)):
            self.best, self.since = robustness, 0
        else:
            self.since += 1
        return satisfaction == 1 and self.since >= self.checkpoints


class StepCounter:
    """Counts an agent's environment steps, against a budget once it has begun."""

    def __init__(self, agent: str) -> None:
        self.taken = 0
        self._agent, self._budget, self._process = agent, math.inf, os.getpid()

    def begin(self, budget: int) -> None:
        self.taken, self._budget = 0, budget

    def add(self, steps: int) -> None:
        """Count steps. Raises `RuntimeError` where they are beyond the budget, or in another process than this."""
        if os.getpid() != self._process:
            raise RuntimeError(f"agent {self._agent} steps an environment in another process, where nothing is counted")
        self.taken += steps
        if self.taken > self._budget:
            raise RuntimeError(f"agent {self._agent} took {self.taken} environment steps, its budget is {self._budget}")

    def check(self, policy: contract.Policy | contract.StatePolicy, reported: int) -> None:
        """Raises `RuntimeError` if it is no policy, or claims more steps than were taken."""
        if not isinstance(policy, contract.Policy | contract.StatePolicy):
            raise RuntimeError(f"agent {self._agent} gives {type(policy).__name__}, the contract says a policy")
        if problem := breach(policy):
            raise RuntimeError(f"agent {self._agent}: of its policy, {problem}")
        if not isinstance(reported, Integral):
            raise RuntimeError(f"agent {self._agent} reports {reported!r} steps, the contract says a whole number")
        if not 0 <= reported <= self.taken:
            raise RuntimeError(
                f"agent {self._agent} reports a policy after {reported} environment steps, and had taken {self.taken}"
            )

    def check_count(self, count: int) -> None:
        """Raises `RuntimeError` if there cannot be so many copies."""
        if not (isinstance(count, Integral) and count > 0):
            rule = "the contract says a whole number, at least 1"
            raise RuntimeError(f"agent {self._agent} makes an environment of {count!r} copies, {rule}")

    def check_trained(self) -> None:
        """Raises `RuntimeError` if no step was taken."""
        if self.taken == 0:
            raise RuntimeError(
                f"agent {self._agent} returned a policy and took no environment step: an agent trains on environments "
                "of `training.make`, or says `trains = False`"
            )

    def __deepcopy__(self, memo: dict[int, Any]) -> StepCounter:
        return self  # the copy of an environment counts where the environment does

    def __reduce__(self) -> NoReturn:
        raise TypeError("an environment of a training cannot be sent elsewhere: its steps would not be counted")


class CountedEnvironment(BatchEnvironment):
    def __init__(self, task: Task, method: contract.RewardMethod, count: int, seed: int, meter: StepCounter) -> None:
        super().__init__(task, method, count, seed)
        self._meter = meter

    def step(self, action: contract.Integers | contract.Array) -> contract.Transition:
        self._meter.add(self.count * self.hold)
        return super().step(action)


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
    except contract.Intractable as reason:
        return cell.ended("intractable", one_line(reason))
    except contract.Unsuitable as reason:
        return cell.ended("unsuitable", one_line(reason))
    numbers = measured.numbers if folder is None else _stored(measured, task, method, cell, folder)
    return cell.ended("done", measurement=numbers)


class Measured(NamedTuple):
    numbers: Measurement
    assessment: Assessment  # the selected policy's report
    selected: contract.Policy | contract.StatePolicy
    final: contract.Policy | contract.StatePolicy
    observation_size: int  # D; 0 where no environment was made
    kept: contract.Arrays  # as of `Trained`


def _stored(measured: Measured, task: Task, method: contract.RewardMethod, cell: Cell, folder: Path) -> Measurement:
    """Save traces and policies in a folder of results; the numbers, which say by what hashes policies are known."""
    files = cell_files(folder, cell.id, cell.key)
    array_files.save_traces(inside(files.traces, folder), measured.assessment, task.signals)
    digests = array_files.save_policies(inside(files.policies, folder), measured.selected, measured.final)
    if measured.kept:
        array_files.save_training(inside(files.training, folder), measured.final, measured.kept, subject(cell))
    if digests is None:
        return measured.numbers
    recipe = cell.recipe or Recipe()
    shown = observation_of(task, method, str(cell.id.method))
    stored = StoredPolicies(*digests, measured.observation_size, dict(recipe.agent), recipe.hold, shown)
    return replace(measured.numbers, policies=stored)


def measure(
    task: Task, method: contract.RewardMethod, agent: contract.Agent, cell: Cell, begun: Stored | None = None
) -> Measured:
    """Train, perhaps from the arrays of an earlier training, and score the selected and the final policy."""
    whole = Clock()
    budget = task.budget(cell.id.budget)
    referee = Referee(task, method, budget.random_starts)
    trained = train(task, method, agent, cell, referee.look if budget.patience == 0 else referee.glance, begun)
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
    return Measured(measurement, assessment, selected.policy, trained.final, trained.observation_size, trained.kept)


def _planned(
    agent: contract.Agent, policy: contract.Policy | contract.StatePolicy, assessment: Assessment
) -> Planned | None:
    """The value that the policy of an agent that plans expects from the report's starts; None for one that learns."""
    if agent.plans is None:
        return None
    assert assessment.states is not None
    values = policy.value(assessment.states[:, 0]) if isinstance(policy, contract.StatePolicy) else np.nan
    return Planned(agent.plans, float(np.mean(values)))


def _choose(referee: Referee, reported: Sequence[Checkpoint]) -> tuple[Checkpoint, tuple[CurvePoint, ...]]:
    choice = referee.choose([checkpoint.policy for checkpoint in reported])
    scores = zip(choice.satisfaction.tolist(), choice.robustness_mean.tolist(), choice.starts.tolist(), strict=True)
    curve = [CurvePoint(at.steps, at.cpu_seconds, *score) for at, score in zip(reported, scores, strict=True)]
    return reported[choice.best], tuple(curve)


def reward_time(
    task: Task, method: contract.RewardMethod, rows: int = 1024, repeats: int = 5, rounds: int = 10
) -> float:
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


def _repeated(
    along: Callable[[contract.Array], tuple[contract.Array, contract.Array]], memory: contract.Array, repeats: int
) -> int:
    """CPU nanoseconds of so many calls, each with the memory that the one before it left."""
    begin = time.process_time_ns()
    for _ in range(repeats):
        _, memory = along(memory)
    return time.process_time_ns() - begin
