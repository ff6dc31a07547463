"""The optimum of either-or by a mixed-integer linear programme, as stlpy solves it (there with Gurobi or Drake).

The programme has the formula's robustness rho as its objective. A binary variable says for each step and region, or
each side of the obstacle, whether it is the one that counts; where it is 1, rho is at most the margin there (big M).
Speeds stay in [-1, 1] by constraints, as in stlpy. The forces that are found are then replayed in the task's system.

    python studies/either_or.py

It takes some seconds, and prints rho of the programme and of the replay, with the targets one by one and both.
"""

from __future__ import annotations

import numpy as np
from programme import Programme

from stlbench import stl
from stlbench.contract import Array
from stlbench.task import load_task

STEPS, DWELL = 20, 5
TARGETS = ((1.0, 2.0, 6.0, 7.0), (7.0, 8.0, 4.5, 5.5))
GOAL, OBSTACLE = (7.0, 8.0, 8.0, 9.0), (3.0, 5.0, 4.0, 6.0)
"""x_min, x_max, y_min, y_max, as in stlpy's example."""
START, FORCE, SPEED, BOX = (2.0, 2.0, 0.0, 0.0), 0.5, 1.0, (0.0, 10.0)
M = 40.0
"""More than any margin less any robustness."""


def solve(targets: tuple[tuple[float, ...], ...]) -> tuple[float, Array]:
    """The greatest robustness with these targets, and the forces (STEPS, 2) that reach it.

    Raises `RuntimeError` where no optimum was proven.
    """
    programme = Programme()
    rho = programme.variable(-M / 8, M / 8)
    states, forces = _motion(programme)
    at_goal = [_inside(programme, rho, states[t : t + 1], GOAL) for t in range(STEPS + 1)]
    windows = [states[t : t + DWELL + 1] for t in range(STEPS - DWELL + 1)]
    at_target = [_inside(programme, rho, window, target) for window in windows for target in targets]
    programme.require(dict.fromkeys(at_goal, 1.0), 1)
    programme.require(dict.fromkeys(at_target, 1.0), 1)
    for state in states:
        sides = [_beyond(programme, rho, state, *side) for side in _sides(OBSTACLE, outside=True)]
        programme.require(dict.fromkeys(sides, 1.0), 1)
    found = programme.maximise(rho, mip_rel_gap=1e-6)
    if found.status != 0:
        raise RuntimeError(found.message)
    values: Array = found.x
    return float(values[rho]), values[np.array(forces)]


def _motion(programme: Programme) -> tuple[list[list[int]], list[list[int]]]:
    """The variables of all states and forces, bound by the double integrator."""
    first = [programme.variable(value, value) for value in START]
    states, forces = [first], list[list[int]]()
    for _ in range(STEPS):
        places = [programme.variable(*BOX) for _ in range(2)]
        speeds = [programme.variable(-SPEED, SPEED) for _ in range(2)]
        forces.append([programme.variable(-FORCE, FORCE) for _ in range(2)])
        before = states[-1]
        for i in range(2):
            programme.require({places[i]: 1, before[i]: -1, before[2 + i]: -1}, 0, 0)
            programme.require({speeds[i]: 1, before[2 + i]: -1, forces[-1][i]: -1}, 0, 0)
        states.append(places + speeds)
    return states, forces


def _inside(programme: Programme, rho: int, states: list[list[int]], region: tuple[float, ...]) -> int:
    """A binary variable: where it is 1, rho is at most the margin inside a region, at all of these states."""
    chosen = programme.variable(0, 1, whole=True)
    for state in states:
        for axis, sign, end in _sides(region, outside=False):
            programme.require({state[axis]: sign, rho: -1, chosen: -M}, sign * end - M)
    return chosen


def _beyond(programme: Programme, rho: int, state: list[int], axis: int, sign: float, end: float) -> int:
    """A binary variable: where it is 1, rho is at most the distance beyond one side."""
    chosen = programme.variable(0, 1, whole=True)
    programme.require({state[axis]: sign, rho: -1, chosen: -M}, sign * end - M)
    return chosen


def _sides(region: tuple[float, ...], outside: bool) -> list[tuple[int, float, float]]:
    """Axis, direction and end of the half-planes that meet in a region, or of those that make up what is outside."""
    direction = -1.0 if outside else 1.0
    return [(i // 2, direction * (-1.0) ** (i % 2), end) for i, end in enumerate(region)]


def replayed(forces: Array) -> float:
    """The robustness that the task's own system and formula give to these forces."""
    task = load_task("either-or")
    states = [np.array([START])]
    for force in forces:
        states.append(task.system.step(states[-1], force[None]))
    traces = task.system.signals(np.stack(states, axis=1))
    return float(stl.robustness(task.formula, traces, task.signals)[0])


if __name__ == "__main__":
    for name, targets in (("first target", TARGETS[:1]), ("second target", TARGETS[1:]), ("either", TARGETS)):
        value, forces = solve(targets)
        print(f"{name}: {value:.6f}, replayed {replayed(forces):.6f}")
