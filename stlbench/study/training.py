"""The training of one cell: by the clock, within its budget of environment steps."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from numbers import Integral
from typing import Any, NamedTuple, NoReturn

from stlbench.contract import Agent, Array, Arrays, Integers, Policy, RewardMethod, StatePolicy, Training, Transition
from stlbench.registry.breaches import breach
from stlbench.rollout.environment import BatchEnvironment
from stlbench.rollout.model import model_of
from stlbench.rollout.rehearsal import rehearse
from stlbench.study.cell import Cell, derive_seed
from stlbench.task import Task


@dataclass
class Clock:
    """CPU and wall seconds, without the spans during which it is paused."""

    cpu: float = 0.0
    wall: float = 0.0
    _since: tuple[float, float] = field(default_factory=lambda: (time.process_time(), time.perf_counter()))

    def pause(self) -> None:
        self.cpu += time.process_time() - self._since[0]
        self.wall += time.perf_counter() - self._since[1]

    def resume(self) -> None:
        self._since = (time.process_time(), time.perf_counter())


class Checkpoint(NamedTuple):
    policy: Policy | StatePolicy
    steps: int
    cpu_seconds: float  # of training so far


class Trained(NamedTuple):
    final: Policy | StatePolicy
    checkpoints: list[Checkpoint]  # at least one: the final policy of an agent that reported none
    env_steps: int
    clock: Clock
    observation_size: int


def train(
    task: Task,
    method: RewardMethod,
    agent: Agent,
    cell: Cell,
    score: Callable[[Policy | StatePolicy], tuple[float, float]],
    initial: Arrays | None = None,
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

    def report(policy: Policy | StatePolicy, steps: int) -> bool:
        clock.pause()
        meter.check(policy, steps)
        reported.append(Checkpoint(policy, steps, clock.cpu))
        enough = patience is not None and patience.ends(*score(policy))
        late = budget.seconds is not None and clock.wall >= budget.seconds
        clock.resume()
        return enough or late

    def make(count: int) -> CountedEnvironment:
        meter.check_count(count)
        used.append(CountedEnvironment(task, method, count, derive_seed(plugin, "initial states", seed), meter))
        return used[-1]

    plugin, seed = task.choice.name, cell.id.seed
    random = derive_seed(plugin, cell.id.agent.name, "training", seed)
    training = Training(make, budget.steps, random, report, budget.checkpoints, initial=initial)
    if agent.plans is not None:
        training = replace(training, model=model_of(task, method))
    else:
        rehearse(agent, training, task.file.hold)
    meter.begin(budget.steps)
    clock.resume()
    final = agent.train(training)
    clock.pause()
    meter.check(final, meter.taken)
    if agent.trains and agent.plans is None:
        meter.check_trained()
    taken = meter.taken
    size = max((environment.observation_size for environment in used), default=0)
    return Trained(final, reported or [Checkpoint(final, taken, clock.cpu)], taken, clock, size)


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

    def check(self, policy: Policy | StatePolicy, reported: int) -> None:
        """Raises `RuntimeError` if it is no policy, or claims more steps than were taken."""
        if not isinstance(policy, Policy | StatePolicy):
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
    def __init__(self, task: Task, method: RewardMethod, count: int, seed: int, meter: StepCounter) -> None:
        super().__init__(task, method, count, seed)
        self._meter = meter

    def step(self, action: Integers | Array) -> Transition:
        self._meter.add(self.count * self.hold)
        return super().step(action)
