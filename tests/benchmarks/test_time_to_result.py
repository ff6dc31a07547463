"""CPU seconds of training until the referee first sees 95 % of its starts satisfied, dqn against SB3's DQN."""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import dataclass, field
from statistics import median

import pytest

from benchmarks.conftest import Race
from stlbench.contract import Policy, Training
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.referee import Referee
from stlbench.study.cell import derive_seed
from stlbench.task import build_agent, build_method, load_task
from stlbench.task.task import Task

pytestmark = pytest.mark.benchmark(timer=time.process_time, group="time to result")

WANTED = 0.95
SEEDS = {"hold-disc": 9, "integrator-or": 9, "robot-nav": 3}
CHECKPOINTS = 200
PATIENCE, FLOOR = 12.0, 5.0
"""A peer is stopped at FLOOR CPU seconds and PATIENCE times our median; what it needs is more then."""
SINGLE = "sb3-dqn[copies=1]"
SINGLE_SHARE = 8
"""SB3 with one environment updates after every step: it is given an eighth of the steps, twice the updates."""


class _EnoughError(Exception):
    """Training may stop."""


@dataclass
class _Stopwatch:
    """Reports to the referee, off the clock, until he is content or the time is up."""

    referee: Referee
    limit: float = float("inf")
    cpu: float = 0.0
    reached: bool = False
    since: float = field(default_factory=time.process_time)

    def __call__(self, policy: Policy, steps: int) -> None:
        self.cpu += time.process_time() - self.since
        self.reached = self.referee.select(policy)[0] >= WANTED
        if self.reached or self.cpu > self.limit:
            raise _EnoughError
        self.since = time.process_time()


@pytest.mark.parametrize("task", SEEDS)
def test_time_to_result(race: Race, task: str) -> None:
    """The funnel's reward, budget `quick`. SB3 has the task's recipe, 16 copies, or one environment, as usual with it.

    The ratio is that of medians over seeds. Where a peer is stopped before it is there, it is a lower bound; a text
    under `..._reached` tells.
    """
    entry, seeds = load_task(task), range(SEEDS[task])
    name = f"time_to_95_{task.replace('-', '_')}"
    ours = [_seconds(entry, "dqn", seed) for seed in seeds]
    assert all(reached for _, reached in ours), f"dqn does not reach {WANTED:.0%} on {task}: {ours}"
    usual = median(cpu for cpu, _ in ours)
    race.run(lambda: None, {}, turns=1)
    race.note(**{f"{name}_dqn_seconds": [cpu for cpu, _ in ours]})
    for key, agent, share in (("sb3", "sb3-dqn", 1), ("sb3_single", SINGLE, SINGLE_SHARE)):
        theirs = [_seconds(entry, agent, seed, share, FLOOR + PATIENCE * usual) for seed in seeds]
        race.note(
            **{f"{name}_vs_{key}": median(cpu for cpu, _ in theirs) / usual},
            **{f"{name}_{key}_seconds": [cpu for cpu, _ in theirs]},
            **{f"{name}_{key}_reached": f"{sum(reached for _, reached in theirs)} of {len(seeds)} seeds"},
        )


def _seconds(entry: Task, agent_text: str, seed: int, share: int = 1, limit: float = math.inf) -> tuple[float, bool]:
    """CPU seconds, and whether the referee was content by then."""
    method, agent = build_method(entry, "funnel"), build_agent(entry, agent_text)

    def make(count: int) -> BatchEnvironment:
        return BatchEnvironment(entry, method, count, derive_seed(entry.name, "initial states", seed))

    steps = entry.budget("quick").steps // share
    agent.train(Training(make, max(1, steps // 200), seed, lambda policy, taken: None, 1))  # to warm up
    watch = _Stopwatch(Referee(entry, method), limit)
    with suppress(_EnoughError):
        agent.train(Training(make, steps, seed, watch, CHECKPOINTS))
    return watch.cpu, watch.reached
