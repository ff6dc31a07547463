"""What a reward method costs: its share of a training step, and how it grows with the formula's horizon."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from statistics import median
from typing import Any

import numpy as np
import pytest

from benchmarks.conftest import Race, seconds
from stlbench.contract import Intractable, RewardMethod, Training
from stlbench.simulation.environment import BatchEnvironment, Simulator
from stlbench.study.fitting import refuse_dear
from stlbench.task import build_agent, build_method, load_task
from stlbench.task.task import Task

pytestmark = pytest.mark.benchmark(timer=time.process_time, group="methods")

METHODS = ("funnel", "flag", "tau-mdp", "raw")
TASKS = ("hold-disc", "hold-disc-coarse", "integrator-or", "robot-nav")
HORIZONS = (10, 30, 100, 300, 1000, 3000, 10_000)
LOCK_STEPS = 1500
COPIES = 16


class Timed(BatchEnvironment):
    """An environment that notes the time of the method: its starts, its rewards and its inputs.

    By `perf_counter`, as the system call behind the clock of CPU time takes longer than some of what is timed. The
    whole is taken by the same clock, so what runs beside hits both alike.
    """

    def __init__(self, task: Task, method: RewardMethod, count: int) -> None:
        self.spent = 0.0
        for name in ("start", "along", "inputs"):
            setattr(method, name, self._timed(getattr(method, name)))
        super().__init__(task, method, count, seed=0)

    def _timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any) -> Any:
            begin = time.perf_counter()
            answer = function(*arguments)
            self.spent += time.perf_counter() - begin
            return answer

        return timed


@pytest.mark.parametrize("method", METHODS)
def test_share_of_training(race: Race, method: str) -> None:
    """Seconds in the method over those of training by the task's own recipe; the headline is the worst task's."""
    worst: list[float] = []
    for task in TASKS:
        entry = load_task(task)
        try:
            shares = _shares(entry, method)
        except Intractable as reason:
            race.note(**{_key("method_share", method, task): f"intractable: {reason}"})
            continue
        race.note(**{_key("method_share", method, task): shares})
        worst = max(worst, shares, key=lambda values: median(values) if values else 0.0)
    race.run(lambda: None, {}, turns=1)
    race.note(**{_key("method_share", method): worst})


def _shares(entry: Task, method: str) -> list[float]:
    agent, made = build_agent(entry, "dqn"), list[Timed]()

    def make(count: int) -> BatchEnvironment:
        made.append(Timed(entry, build_method(entry, method), count))
        return made[-1]

    refuse_dear(entry, build_method(entry, method), agent, entry.budget("quick").steps)
    training = Training(make, LOCK_STEPS * COPIES * entry.file.hold, 0, lambda policy, steps: None, 1)
    agent.train(training)  # to warm up
    times = [seconds(lambda: agent.train(training), time.perf_counter) for _ in range(5)]
    return [each.spent / whole for each, whole in zip(made[1:], times, strict=True)]


def _key(*parts: str) -> str:
    return "_".join(parts).replace("-", "_")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("horizon", HORIZONS)
def test_cost_against_horizon(race: Race, method: str, horizon: int) -> None:
    """CPU nanoseconds a transition in a batch of 16, and the numbers that the policy is shown more."""
    entry = _stay(horizon)
    reward = build_method(entry, method)
    simulator = Simulator(entry, reward)
    generator = np.random.default_rng(0)
    simulator.reset(np.column_stack([generator.uniform(1.1, 2.9, (COPIES, 2)), np.zeros(COPIES)]))
    action = entry.actions.vectors[generator.integers(entry.actions.size, size=COPIES)]
    after = entry.system.signals(entry.system.step(simulator.state, action))
    repeats = max(20, 20_000 // horizon)
    samples, memory = np.stack([simulator.signals, after]), simulator.memory

    def steps() -> None:
        nonlocal memory
        for _ in range(repeats):
            _, memory = reward.along(samples, action, simulator.t, memory)

    times = race.run(steps, {}, turns=5)["ours"]
    name = _key("reward", method, str(horizon))
    race.note(**{f"{name}_nanoseconds": [each * 1e9 / repeats / COPIES for each in times]})
    race.note(**{f"{name}_inputs": reward.input_size})


def _stay(horizon: int) -> Task:
    """hold-disc with G[0,H] psi for its formula; tau-mdp reads it as G[0,0] G[0,H] psi, a window of H + 1 samples."""
    entry = load_task("hold-disc")
    psi = "(norm(x - 2, y - 2) <= 1)"
    changes: dict[str, Any] = {"formula": f"G[0,{horizon}] {psi}", "nested": f"G[0,0] G[0,{horizon}] {psi}"}
    changes |= {"steps": horizon, "protocols": {}}
    return replace(entry, file=entry.file.model_copy(update=changes))
