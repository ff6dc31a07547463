"""What a task on an environment of Gymnasium costs: PPO of SB3 in the harness, and on the wrapped environment alone."""

from __future__ import annotations

import time
from typing import Any

import gymnasium
import pytest

import stlbench
from benchmarks.conftest import Race, ratios, without
from stlbench.contract import GymTask
from stlbench.registry.choices import Choice
from stlbench.simulation.environment import BatchEnvironment
from stlbench.task import build_method
from stlbench.task.file import TaskFile
from stlbench.task.task import Task

pytestmark = pytest.mark.benchmark(timer=time.process_time, group="gym-task")

STEPS = 8192
FORMULA, NAMES, RANGES = "G[100,200] abs(theta) <= 0.2", ("x", "y", "omega"), {"theta": (-3.2, 3.2)}
THETA = "atan2(y, x)"


def pendulum() -> Task:
    """Gymnasium's pendulum, as a task file has it."""
    content = {
        **{"title": "Gymnasium's pendulum", "source": "Pendulum-v1", "formula": FORMULA},
        **{"sampling_time": 0.05, "steps": 200, "agents": {"sb3-ppo": {}}, "budgets": {"quick": {"steps": STEPS}}},
        "environment": {"id": "Pendulum-v1", "names": NAMES, "scale": {"omega": 8}},
        "signals": {"theta": {"low": -3.2, "high": 3.2, "expression": THETA}},
    }
    return Task(Choice("pendulum-v1"), TaskFile.model_validate(content), GymTask())


def test_ppo_on_gymnasiums_pendulum(race: Race) -> None:
    """CPU seconds of as many steps: above 1 the harness takes less than SB3 on `stlbench.wrap`."""
    if missing := without(["stable_baselines3"]):
        race.note(gym_task_vs_sb3_alone=missing["stable_baselines3"])
        pytest.skip(missing["stable_baselines3"])
    from stable_baselines3 import PPO
    from stable_baselines3.common.vec_env import DummyVecEnv

    from stlbench_agents.sb3 import SB3PPO

    task, agent = pendulum(), SB3PPO()
    environment = BatchEnvironment(task, build_method(task, "funnel"), agent.copies, seed=0)
    options: dict[str, Any] = agent.options(environment)

    def ours() -> None:
        agent.model(environment, seed=0).learn(STEPS)

    def alone() -> None:
        copies = DummyVecEnv([_wrapped] * agent.copies)
        PPO("MlpPolicy", copies, device="cpu", seed=0, **options).learn(STEPS)

    times = race.run(ours, {"alone": alone}, turns=5)
    race.note(gym_task_vs_sb3_alone=ratios(times["alone"], times["ours"]))


def _wrapped() -> Any:
    env = gymnasium.make("Pendulum-v1", disable_env_checker=True)
    return stlbench.wrap(env, FORMULA, signals={"theta": THETA}, names=NAMES, ranges=RANGES, method="funnel")
