"""Training steps per second on the pendulum, one update of batch 128 per step: DQN with an MLP of 128 x 128, and TD3.

All have the same environment and the same hyperparameters: one-step returns, Adam; for DQN no double Q-learning, target
copied every 1000 updates, gradients clipped to norm 10, epsilon 0.05. Ours runs it twice: with one copy of the
environment, and with the copies that its recipes have, and as many updates after each lock-step.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from benchmarks.conftest import Race, Work, ratios, without
from benchmarks.pendulum import environment, pendulum, training
from stlbench.task.task import Task
from stlbench_agents.dqn import DQN
from stlbench_agents.td3 import TD3

pytestmark = pytest.mark.benchmark(timer=time.process_time, group="training")

STEPS = 2048
BATCH = 128
WIDTH = 128
#: peer -> the modules that it needs
NEEDED = {"sb3": ("stable_baselines3",), "sbx": ("sbx",), "torch": ("torch",), "jax": ("jax", "optax")}
Times = Mapping[str, Sequence[float]]
LIBRARIES = {"sb3": "stable_baselines3", "sbx": "sbx"}


@pytest.mark.parametrize("actions", [61, 273])
def test_training(race: Race, actions: int) -> None:
    """Steps a second of each, ratios, and shares of the time that the matrix products alone would take."""
    task, lacking = pendulum(actions), _lacking()
    peers = {name: make for name, make in _dqns(task, actions).items() if _peer(name) not in lacking}
    times = race.run(_dqn(task, copies=16), {name: make() for name, make in peers.items()}, turns=5)
    name = f"train_{actions}"
    _note_peers(race, name, times, ("sb3", "sbx", "torch"), lacking)
    _note_jax(race, "dqn" if actions == 61 else f"dqn_{actions}", {1: "single", 16: "ours"}, times, lacking)
    race.note(
        **{f"{name}_steps_per_second_{who}": [STEPS / each for each in times[who]] for who in times},
        **{f"{name}_share_of_sgemm_{who}": ratios(times["sgemm"], times[who]) for who in times if who != "sgemm"},
    )


def test_continuous_training(race: Race) -> None:
    """TD3 with any torque: steps a second of each, and ratios."""
    task, lacking = pendulum(None), _lacking()
    peers = {name: make for name, make in _td3s(task).items() if _peer(name) not in lacking}
    times = race.run(_td3(task, copies=8), {name: make() for name, make in peers.items()}, turns=5)
    _note_peers(race, "td3", times, ("sb3", "sbx"), lacking)
    _note_jax(race, "td3", {1: "single", 8: "ours"}, times, lacking)
    race.note(**{f"td3_steps_per_second_{who}": [STEPS / each for each in times[who]] for who in times})


def _lacking() -> dict[str, str]:
    """Peer -> why it is not there."""
    return {peer: reason for peer, names in NEEDED.items() for reason in without(names).values()}


def _peer(name: str) -> str:
    """`jax_16` is of jax."""
    return name.partition("_")[0]


def _note_peers(race: Race, name: str, times: Times, peers: Sequence[str], lacking: Mapping[str, str]) -> None:
    """How many times as fast as each we are, with all copies and with one."""
    for key, ours in (("", "ours"), ("_single", "single")):
        for peer in peers:
            value = lacking[peer] if peer in lacking else ratios(times[peer], times[ours])
            race.note(**{f"{name}{key}_vs_{peer}": value})


def _note_jax(race: Race, name: str, works: Mapping[int, str], times: Times, lacking: Mapping[str, str]) -> None:
    """The same of the JAX program, with as many copies as ours."""
    for copies, ours in works.items():
        value = lacking["jax"] if "jax" in lacking else ratios(times[f"jax_{copies}"], times[ours])
        race.note(**{f"{name}_{copies}_vs_jax": value})


def _dqns(task: Task, actions: int) -> dict[str, Callable[[], Work]]:
    """What runs beside ours."""
    return {
        **{key: _library(library, "DQN", task) for key, library in LIBRARIES.items()},
        "torch": lambda: _torch(task),
        "jax_1": lambda: _jax(actions, copies=1),
        "jax_16": lambda: _jax(actions, copies=16),
        "single": lambda: _dqn(task, copies=1),
        "sgemm": lambda: _products(environment(task, 1).observation_size, actions),
    }


def _td3s(task: Task) -> dict[str, Callable[[], Work]]:
    return {
        **{key: _library(library, "TD3", task) for key, library in LIBRARIES.items()},
        "jax_1": lambda: _jax(None, copies=1),
        "jax_8": lambda: _jax(None, copies=8),
        "single": lambda: _td3(task, copies=1),
    }


def _dqn(task: Task, copies: int) -> Work:
    sizes: dict[str, Any] = {"net_arch": (WIDTH, WIDTH), "head": "joint", "batch_size": BATCH, "n_steps": 1}
    rules: dict[str, Any] = {"double": False, "tau": 1.0, "target_update_interval": 1000, "averaging": 0.0}
    agent = DQN(**sizes, **rules, copies=copies, gradient_steps=copies, exploration_initial_eps=0.05)
    return training(agent, task, STEPS)


def _td3(task: Task, copies: int) -> Work:
    sizes: dict[str, Any] = {"net_arch": (64, 64), "batch_size": BATCH, "buffer_size": 65536, "random_steps": 1}
    return training(TD3(**sizes, copies=copies, gradient_steps=copies), task, STEPS)


def _library(library: str, agent: str, task: Task) -> Callable[[], Work]:
    def make() -> Work:
        from benchmarks.peers_sb3 import sb3_training

        return sb3_training(library, agent, environment(task, 1), STEPS)

    return make


def _torch(task: Task) -> Work:
    from benchmarks.peers_torch import TorchDQN

    learner = TorchDQN(environment(task, 1))
    return lambda: learner.steps(STEPS)


def _jax(actions: int | None, copies: int) -> Work:
    from benchmarks.peers_jax import JaxDQN, JaxTD3, check_pendulum, jax_training

    check_pendulum()
    return jax_training(JaxTD3() if actions is None else JaxDQN(actions), copies, STEPS)


def _products(inputs: int, actions: int) -> Work:
    """The matrix products of STEPS updates by the book, and nothing else: the limit of the core's sgemm.

    Each layer is passed forwards in the target and in the online network, and backwards for its weights and, but for
    the first layer, for its inputs; the last layer has all its outputs.
    """
    generator = np.random.default_rng(0)
    shapes = []
    for rows, columns in ((inputs, WIDTH), (WIDTH, WIDTH), (WIDTH, actions)):
        shapes += 2 * [(BATCH, rows, columns)] + [(rows, BATCH, columns)]
        if rows == WIDTH:
            shapes.append((BATCH, columns, rows))

    def matrix(*shape: int) -> Any:
        return generator.standard_normal(shape, dtype=np.float32)

    operands = [(matrix(m, n), matrix(n, k), matrix(m, k)) for m, n, k in shapes]

    def work() -> None:
        for _ in range(STEPS):
            for left, right, out in operands:
                np.dot(left, right, out=out)

    return work
