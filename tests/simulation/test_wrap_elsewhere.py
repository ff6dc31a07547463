"""`stlbench.wrap` against the checkers of two libraries, and against the harness's simulator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box
from gymnasium.utils.env_checker import check_env
from helpers.walk_env import Walk, wrapped

import stlbench
from stlbench.registry import plugins
from stlbench.registry.choices import Choice
from stlbench.simulation import referee
from stlbench.simulation.environment import Simulator
from stlbench.simulation.gymnasium.wrap import StlWrapper
from stlbench.task import Task, load_task

CART: dict[str, Any] = {
    "names": ("x", "v", "theta", "omega"),
    "ranges": {"theta": (-0.42, 0.42)},
    "method": "funnel",
}
PENDULUM: dict[str, Any] = {
    "signals": lambda observation, info: {"theta": np.arctan2(observation[1], observation[0])},
    "ranges": {"theta": (-3.2, 3.2)},
}


@pytest.mark.parametrize(
    "make",
    [
        lambda: stlbench.wrap(
            gymnasium.make("Pendulum-v1", max_episode_steps=30),
            "F[0,9] G[0,9] abs(theta) <= 0.2",
            method="flag",
            **PENDULUM,
        ),
        lambda: wrapped(Walk(noise=0.1), "F[0,3] x >= 1", steps=8, method="funnel"),
        lambda: wrapped(Walk(noise=0.1, kind="dict"), names={"place": ("x", "minus")}, terminated="interval"),
    ],
    ids=["pendulum", "random", "dict"],
)
@pytest.mark.filterwarnings("ignore::UserWarning")  # of the environments themselves, and that they are wrapped
def test_gymnasium_and_stable_baselines_accept_it(make: Callable[[], StlWrapper]) -> None:
    from stable_baselines3.common.env_checker import check_env as check_for_sb3

    check_env(make(), skip_render_check=True)  # pictures need pygame
    check_for_sb3(make())


@pytest.mark.slow
def test_stable_baselines_trains_on_it_and_its_monitor_has_the_verdict() -> None:
    from stable_baselines3 import DQN
    from stable_baselines3.common.monitor import Monitor

    env = stlbench.wrap(gymnasium.make("CartPole-v1"), "G abs(theta) <= 0.2", **CART)
    watched = Monitor(env, info_keywords=("robustness", "satisfied"))
    model = DQN("MlpPolicy", watched, learning_starts=10, seed=0).learn(80)
    assert [row["satisfied"] for row in model.ep_info_buffer or ()]


def test_torchrl_takes_it() -> None:
    torchrl: Any = pytest.importorskip("torchrl.envs", reason="TorchRL is not installed")
    env = stlbench.wrap(gymnasium.make("CartPole-v1"), "G abs(theta) <= 0.2", **CART)
    reading = torchrl.GymWrapper(env).auto_register_info_dict()
    episode = reading.rollout(500)["next"]
    assert bool(episode["done"][-1])
    assert episode["observation"].shape[1:] == env.observation_space.shape
    assert episode["robustness"][-1] < 0 <= episode["t"][-1]


# --------------------------------------------------------------------------------------- the same as within the harness


class Shown(gymnasium.Env[Any, Any]):
    """A task's system, without reward or time, as somebody else would have written it."""

    def __init__(self, task: Task) -> None:
        self.task, self.action_space = task, gymnasium.spaces.Discrete(task.actions.size)  # type: ignore[union-attr]
        size = task.system.features(np.zeros((1, len(task.system.state))), np.array([0])).shape[1]
        self.observation_space = Box(-np.inf, np.inf, (size,), np.float64)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.state, self.t = np.array([(options or {})["state"]]), 0
        return self._observe()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        self.state = self.task.system.step(self.state, self.task.actions.vectors[[action]])  # type: ignore[union-attr]
        self.t += 1
        observation, info = self._observe()
        return observation, 0.0, False, False, info

    def _observe(self) -> tuple[Any, dict[str, Any]]:
        signals = dict(zip(self.task.signals, self.task.system.signals(self.state)[0], strict=True))
        return self.task.system.features(self.state, np.array([self.t]))[0], signals


@pytest.mark.parametrize("method", ["funnel", "flag", "raw", "tau-mdp"])
def test_rewards_memory_and_robustness_are_those_of_the_simulator(method: str) -> None:
    task = load_task("hold-disc")
    plain = replace(task.specification, nested=None)
    simulator = Simulator(task, plugins.build("methods", Choice(method), plain))
    file, start = task.file, np.array([[2.4, 1.8, 0.3]])
    ranges = {name: (signal.low, signal.high) for name, signal in file.signals.items()}
    env = stlbench.wrap(Shown(task), str(task.formula), ranges=ranges, method=method, steps=file.steps)
    theirs, (ours, info) = simulator.reset(start), env.reset(options={"state": start[0]})
    np.testing.assert_array_equal(ours, theirs[0])
    generator, trace = np.random.default_rng(3), [simulator.signals.copy()]
    while info["t"] < file.steps:
        action = generator.integers(task.actions.size, size=1)  # type: ignore[union-attr]
        held = simulator.advance(action)
        ours, reward, *_, info = env.step(action[0])
        np.testing.assert_array_equal(ours, simulator.observe()[0])
        assert reward == held.reward[0]
        trace.append(held.samples[:, 0])
    score = referee.score(task, np.stack(trace, axis=1))
    assert (info["robustness"], info["satisfied"]) == (score.robustness[0], score.satisfied[0])
