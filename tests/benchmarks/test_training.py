"""Training steps per second: deep Q-learning on the pendulum, one update of batch 128 per step, MLP 128 x 128.

All run the same environment and the same hyperparameters: no double Q-learning, one-step returns, target copied every
1000 updates, Adam, gradients clipped to norm 10, epsilon 0.05. Ours runs it twice: with one copy of the environment,
and with the 16 copies that its recipes have, and 16 updates after each lock-step.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from benchmarks.conftest import Race, ratios
from benchmarks.pendulum import pendulum
from stlbench.contract import Training
from stlbench.rollout.environment import BatchEnvironment
from stlbench.task import build_method
from stlbench.task.task import Task

pytestmark = pytest.mark.benchmark(timer=time.process_time, group="training")

STEPS = 2048
BATCH = 128
WIDTH = 128


@pytest.mark.parametrize("actions", [61, 273])
def test_training(race: Race, actions: int) -> None:
    """Steps a second of each, ratios, and shares of the time that the matrix products alone would take."""
    task = pendulum(actions)
    environment = _environment(task, 1)
    peers = {
        "sb3": _sb3(task),
        "torch": _torch(task),
        "single": _dqn(task, copies=1),
        "sgemm": _products(environment.observation_size, actions),
    }
    times = race.run(_dqn(task, copies=16), peers, turns=5)
    name = f"train_{actions}"
    race.note(
        **{f"{name}_vs_{peer}": ratios(times[peer], times["ours"]) for peer in ("sb3", "torch")},
        **{f"{name}_single_vs_{peer}": ratios(times[peer], times["single"]) for peer in ("sb3", "torch")},
        **{f"{name}_steps_per_second_{who}": [STEPS / each for each in times[who]] for who in times},
        **{f"{name}_share_of_sgemm_{who}": ratios(times["sgemm"], times[who]) for who in times if who != "sgemm"},
    )


def _environment(task: Task, copies: int) -> BatchEnvironment:
    return BatchEnvironment(task, build_method(task, "funnel"), copies, seed=0)


def _dqn(task: Task, copies: int) -> Callable[[], Any]:
    from stlbench_agents.dqn import DQN

    agent = DQN(
        net_arch=(WIDTH, WIDTH), head="joint", copies=copies, gradient_steps=copies, batch_size=BATCH, n_steps=1,
        double=False, tau=1.0, target_update_interval=1000, averaging=0.0, exploration_initial_eps=0.05,
    )  # fmt: skip
    training = Training(lambda count: _environment(task, count), STEPS, 0, lambda policy, steps: None, 1)
    return lambda: agent.train(training)


def _sb3(task: Task) -> Callable[[], Any]:
    from benchmarks.peers_sb3 import sb3_dqn

    model = sb3_dqn(_environment(task, 1))
    return lambda: model.learn(STEPS, reset_num_timesteps=False, log_interval=STEPS)


def _torch(task: Task) -> Callable[[], Any]:
    from benchmarks.peers_torch import TorchDQN

    learner = TorchDQN(_environment(task, 1))
    return lambda: learner.steps(STEPS)


def _products(inputs: int, actions: int) -> Callable[[], Any]:
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
