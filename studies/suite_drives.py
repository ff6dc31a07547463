"""The search for a witness: drives along way points, then a local search over held actions."""

from __future__ import annotations

from functools import cache
from itertools import pairwise

import numpy as np
from held import actions_of, robustness_of, search, taken
from scipy import linalg

from stlbench.contract import ActionGrid, Array
from stlbench.simulation.environment import Simulator
from stlbench.task import Task
from stlbench_tasks.differential_drive import Steering
from stlbench_tasks.suite.systems import Arm, CartPendulum, DoubleIntegrator, Quadrotor, SuiteSystem, Unicycle
from stlbench_tasks.suite.templates import DT, Disc, Scene

_DRIVES, _ELITE, _ROUNDS = 48, 6, 8
"""Drives from each start that are tried at once, those of them that are kept, and the rounds of this."""


class Drives:
    """Many drives from each start along tours, each with its own detours, stops and times of departure."""

    def __init__(self, task: Task, scene: Scene) -> None:
        self.task, self.scene = task, scene
        self.begun = np.repeat(task.starts.report_and_selection()[0], _DRIVES, axis=0)
        self.columns = [[task.signals.index(name) for name in names] for names in scene.about.points]
        self.tours = scene.tours or [scene.regions]
        self.legs = max(map(len, self.tours))

    def __call__(self, numbers: Array, tours: Array) -> Array:
        """Actions (N, decisions, axes) of drives by standard normal numbers (N, legs, 5) along tours (N,)."""
        points = [self._way(point, numbers, tours) for point in range(len(self.scene.about.points))]
        at = np.zeros((len(points), len(numbers)), dtype=np.int64)
        rows = np.arange(len(numbers))

        def act(simulator: Simulator) -> Array:
            aims = []
            for point, (way, near, depart) in enumerate(points):
                away = way[rows, at[point]] - simulator.signals[:, self.columns[point]]
                there = np.linalg.norm(away, axis=1) < near[rows, at[point]]
                at[point] += there & (simulator.t >= depart[rows, at[point]]) & (at[point] < way.shape[1] - 1)
                aims.append(way[rows, at[point]])
            return steer(self.scene.system, simulator.state, np.concatenate(aims, axis=1))

        return actions_of(self.task, self.begun, act)

    def _way(self, point: int, numbers: Array, tours: Array) -> tuple[Array, Array, Array]:
        """Way points (N, W, 2) of one point, how near each counts, and the step before which it is not left."""
        start = self.task.system.signals(self.begun)[:, self.columns[point]]
        names, count, size = self.scene.about.points[point], len(numbers), start.shape[1]
        way, near, depart = (
            np.zeros((count, 2 * self.legs, size)),
            np.zeros((count, 2 * self.legs)),
            np.zeros((count, 2 * self.legs)),
        )
        for number, tour in enumerate(self.tours):
            rows = tours == number
            place, ends, column = start[rows], _ends(self.scene, tour, self.task.file.steps), 0
            for leg, disc in enumerate(tour):
                if disc.names != names:
                    continue
                own = numbers[rows, leg]
                goal = np.array(disc.centre[:size]) + 0.25 * disc.radius * own[:, 2 : 2 + size]
                way[rows, column] = (place + goal) / 2 + 0.8 * own[:, :size]
                near[rows, column], near[rows, column + 1] = 0.5, 0.6 * disc.radius
                way[rows, column + 1], place = goal, goal
                depart[rows, column + 1] = ends[leg] * (1 - 0.25 * np.abs(own[:, 4]))
                column += 2
            way[rows, column:] = place[:, None]
        return way, near, depart


def _ends(scene: Scene, tour: list[Disc], steps: int) -> Array:
    """About the steps at which the legs of a tour end."""
    places = [scene.starts[scene.about.points.index(tour[0].names)], *(disc.centre for disc in tour)]
    legs = np.cumsum([scene.leg(one, other) for one, other in pairwise(places)])
    ends: Array = legs * min(1.0, steps / legs[-1])
    return ends


def steer(system: type[SuiteSystem], state: Array, aims: Array) -> Array:
    """Actions (N, axes) that bring all points from states (N, n) towards aims (N, coordinates of all points)."""
    held = DT * system.about.hold
    if system is Unicycle:
        return Steering(1.0, 0.5, 1.5, 0.5, held)(state, aims[:, 0], aims[:, 1])
    if system is DoubleIntegrator:
        wanted = np.clip(0.9 * (aims - state[:, :2]), -1.2, 1.2)
        return (wanted - state[:, 2:]) / (1.5 * held)
    if system is Quadrotor:
        push = 1.2 * np.clip(aims - state[:, :2], -1.0, 1.0) - 1.5 * state[:, 2:4]
        tilt = np.clip(-push[:, 0] / 9.81, -0.4, 0.4)
        return np.stack([9.81 + push[:, 1], 10 * (tilt - state[:, 4]) - 4 * state[:, 5]], axis=1)
    if system is CartPendulum:
        off = np.concatenate([np.clip(state[:, :1] - aims, -1.0, 1.0), state[:, 1:]], axis=1)
        return -off @ _balance().T
    if system is Arm:
        total = np.cumsum(state, axis=1)
        parts = np.stack([-np.sin(total), np.cos(total)], axis=1) * Arm.links
        jacobian = np.cumsum(parts[..., ::-1], axis=2)[..., ::-1]
        away = (aims - Arm.tip(state)) / held
        inner = jacobian @ jacobian.transpose(0, 2, 1) + 0.1 * np.eye(2)
        return (jacobian.transpose(0, 2, 1) @ np.linalg.solve(inner, away[..., None]))[..., 0]
    return (aims - state) / held


@cache
def _balance() -> Array:
    """The gain (1, 4) of a linear controller that balances the pole and keeps the cart at a place."""
    system = CartPendulum(DT)
    rest, steps = np.zeros((1, 1)), 1e-6 * np.eye(4)[:, None]
    around = [(system.step(one, rest) - system.step(-one, rest)) / 2e-6 for one in steps]
    a, b = np.concatenate(around).T, system.step(np.zeros((1, 4)), np.ones((1, 1))).T
    p = linalg.solve_discrete_are(a, b, np.diag([3.0, 1.0, 10.0, 1.0]), np.eye(1))
    gain: Array = np.linalg.solve(np.eye(1) + b.T @ p @ b, b.T @ p @ a)
    return gain


def witness(task: Task, scene: Scene, seconds: float, seed: int = 0) -> Array:
    """Actions (starts, decisions, axes) of the grid, the best that were found in about so many seconds."""
    drives, generator = Drives(task, scene), np.random.default_rng(seed)
    begun = task.starts.report_and_selection()[0]
    starts, shape = len(begun), (len(begun), _DRIVES, drives.legs, 5)
    mean, spread = np.zeros((starts, 1, *shape[2:])), np.ones((starts, 1, *shape[2:]))
    best, robustness = (
        np.zeros((starts, task.file.decisions, len(task.actions.names))),
        np.full(starts, -np.inf),
    )
    tours = generator.integers(len(drives.tours), size=shape[:2])
    for round_ in range(_ROUNDS):
        numbers = mean + spread * generator.normal(size=shape)
        actions = drives(numbers.reshape(-1, *shape[2:]), tours.ravel())
        found = robustness_of(task, drives.begun, actions).reshape(shape[:2])
        order = np.argsort(-found, axis=1)
        top = np.take_along_axis(found, order[:, :1], axis=1)[:, 0]
        better = top > robustness
        best[better] = actions.reshape(*shape[:2], *actions.shape[1:])[np.arange(starts), order[:, 0]][better]
        robustness[better] = top[better]
        if round_:  # the first drives choose the tours
            elite = np.take_along_axis(numbers, order[:, :_ELITE, None, None], axis=1)
            mean, spread = elite.mean(axis=1, keepdims=True), elite.std(axis=1, keepdims=True) + 0.1
        tours = np.broadcast_to(np.take_along_axis(tours, order[:, :1], axis=1), shape[:2])
    assert isinstance(task.actions, ActionGrid)
    best = task.actions.vectors[taken(task, best)]
    hopeless = robustness.min() < -0.3
    return best if hopeless else search(task, begun, best, seconds)
