"""The paper's pendulum (sec. IV-A), on which training is timed: 61 actions, a grid of 273, or any torque."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import yaml

from stlbench.contract import Agent, Array, Integers, System, Training
from stlbench.registry.choices import Choice
from stlbench.simulation.environment import BatchEnvironment
from stlbench.task import build_method
from stlbench.task.reading import read_task_file
from stlbench.task.task import Task

__all__ = ["Pendulum", "environment", "pendulum", "training"]

_ACTIONS: dict[int | None, dict[str, dict[str, float]]] = {
    None: {"a": {"low": -3, "high": 3}},
    61: {"a": {"low": -3, "high": 3, "count": 61}},
    273: {"a": {"low": -3, "high": 3, "count": 21}, "nothing": {"low": -1, "high": 1, "count": 13}},
}

_FILE: dict[str, Any] = {
    "title": "Inverted pendulum",
    "source": "Saxena, Sandeep, Jagtap, Funnel-based Reward Shaping for STL Tasks in RL, sec. IV-A",
    "formula": (
        "G[400,700] (abs(theta) <= 0.05 & abs(omega) <= 0.05) & "
        "G[1000,1200] (abs(1.57 - theta) <= 0.05 & abs(omega) <= 0.05) & "
        "G[1700,2000] (abs(-1.57 - theta) <= 0.05 & abs(omega) <= 0.05)"
    ),
    "sampling_time": 0.01,
    "steps": 2000,
    "signals": {"theta": {"low": -3.15, "high": 3.15}, "omega": {"low": -8, "high": 8}},
    "initial": {"box": {"theta": [-3.14, 3.14], "omega": [-1, 1]}},
    "agents": {"dqn": {}},
    "budgets": {"smoke": {"steps": 2000}},
}


class Pendulum(System):
    """theta' = theta + dt omega, omega' = omega + dt (g/l sin theta - mu/(m l^2) omega + a/(m l^2))."""

    state = ("theta", "omega")

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later; only the first axis of the action is a torque."""
        theta, omega = state[:, 0], state[:, 1]
        change = 19.6 * np.sin(theta) + (action[:, 0] - 0.05 * omega) / 0.0375
        moved = np.empty_like(state)
        moved[:, 0], moved[:, 1] = theta + self.dt * omega, omega + self.dt * change
        return moved

    def signals(self, state: Array) -> Array:
        """The state, the angle in [-pi, pi)."""
        wrapped = state.copy()
        wrapped[..., 0] = _wrapped(state[..., 0])
        return wrapped

    def features(self, state: Array, t: Integers) -> Array:
        """cos, sin, omega / 5 and the angle's distance from the target of the time, (N, 4)."""
        theta, omega = state[:, 0], state[:, 1]
        target = np.where(t <= 700, 0.0, np.where(t <= 1200, 1.57, -1.57))
        seen = np.empty((len(state), 4))
        seen[:, 0], seen[:, 1], seen[:, 2] = np.cos(theta), np.sin(theta), omega / 5
        seen[:, 3] = _wrapped(theta - target) / np.pi
        return seen


def _wrapped(angle: Array) -> Array:
    return (angle + np.pi) % (2 * np.pi) - np.pi


def pendulum(actions: int | None) -> Task:
    """The task with 61 or 273 actions; None: with any torque between the ends."""
    text = yaml.safe_dump(_FILE | {"actions": _ACTIONS[actions]}, sort_keys=False)
    return Task(Choice("pendulum"), read_task_file(text, "pendulum"), Pendulum(0.01))


def environment(task: Task, copies: int) -> BatchEnvironment:
    """The task under the funnel's reward."""
    return BatchEnvironment(task, build_method(task, "funnel"), copies, seed=0)


def training(agent: Agent, task: Task, steps: int) -> Callable[[], Any]:
    """A function that trains the agent anew for so many steps, without reports on the way."""
    whole = Training(lambda count: environment(task, count), steps, 0, lambda policy, taken: None, 1)
    return lambda: agent.train(whole)
