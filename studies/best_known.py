"""Search for what is best known of a task: one sequence of held actions for each of the report's starts.

    python studies/best_known.py TASK [--seconds 240] [--plan] [--policies FOLDER]

For each start it begins with the best of these: the action zero, the controller by hand, a drive along way points if
the task has some here, and the sequences that were found before. `--plan` adds a plan for the formula, and `--policies`
the selected policies of a folder of results. It changes sequences at random and keeps a change that does not make the
robustness of its start smaller. The sequences go to results/best-known/TASK.npz, where anybody can replay them
(`replay`). The number itself stands in the task file, under `best_known`.

This is meant for systems without noise: a sequence that was made for one course of the noise is no policy.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
from held import actions_of, replay, robustness_of, search

from stlbench.contract import (
    ActionGrid,
    Array,
    Environment,
    Policy,
    RewardMethod,
    StatePolicy,
    Training,
)
from stlbench.simulation import baselines
from stlbench.simulation.baselines import Unpaid
from stlbench.simulation.environment import Simulator, model_of
from stlbench.simulation.verdicts import judge, without_end
from stlbench.study.policies import load_policy
from stlbench.study.results import Results
from stlbench.task import Task, build_agent, load_task
from stlbench_tasks.differential_drive import Steering

FOLDER = Path(__file__).resolve().parent.parent / "results" / "best-known"
_WAYS = {"overlap": ((1.1, 1.25), (2.75, 1.25), (3.0, 1.0), (2.75, 1.25), (0.8, 1.25), (0.8, 2.75), (1.0, 3.0))}
"""Task -> way points x, y of a differential-drive robot."""
_AHEAD, _SPEEDS, _NEAR_POINT = (0.08, 0.12, 0.18, 0.25), (0.5, 0.7, 1.0), (0.02, 0.04)
"""How far ahead on the line it aims, in m; shares of the greatest speed; and how near a way point counts, in m."""


def kept(task: Task) -> Array | None:
    """The sequences (N, decisions, axes) in the folder; None if there are none."""
    path = FOLDER / f"{task.name}.npz"
    return np.load(path)["actions"].astype(np.float64) if path.exists() else None


def by_hand(task: Task, begun: Array) -> Array:
    """The controller's actions from the starts, (N, decisions, axes); the action zero if there is none."""
    zero = baselines.zero(task)

    def act(simulator: Simulator) -> Array:
        vectors = simulator.world.by_hand(simulator.t)
        return np.tile(zero, (len(begun), 1)) if vectors is None else np.asarray(vectors, dtype=np.float64)

    return actions_of(task, begun, act)


def driven(task: Task, begun: Array) -> list[Array]:
    """Actions of a robot that drives along the task's way points, in several manners, (N, decisions, axes) each."""
    if task.name not in _WAYS:
        return []
    manners = product(_AHEAD, _SPEEDS, _NEAR_POINT)
    return [actions_of(task, begun, _drive(task, begun, np.array(_WAYS[task.name]), *manner)) for manner in manners]


def _drive(
    task: Task, begun: Array, points: Array, ahead: float, speed: float, near: float
) -> Callable[[Simulator], Array]:
    """Steers towards a point a little ahead on the line to the next way point."""
    assert isinstance(task.actions, ActionGrid)
    (v, omega), held = task.actions.axes, task.file.sampling_time * task.file.hold
    steer = Steering(speed * v[-1], v[1] - v[0], omega[-1], omega[1] - omega[0], held)
    leg, origin = np.zeros(len(begun), dtype=np.int64), begun[:, :2].copy()

    def act(simulator: Simulator) -> Array:
        place = simulator.state[:, :2]
        there = (np.hypot(*(points[leg] - place).T) < near) & (leg < len(points) - 1)
        origin[there] = points[leg[there]]
        leg[there] += 1
        line = points[leg] - origin
        length = np.maximum(np.hypot(*line.T), near)
        done = ((place - origin) * line).sum(axis=1) / length
        aim = origin + np.clip((done + ahead) / length, 0, 1)[:, None] * line
        return steer(simulator.state, aim[:, 0], aim[:, 1])

    return act


def planned(task: Task, begun: Array) -> Array:
    """The actions of the policy of a plan for the formula, (N, decisions, axes)."""
    unpaid = Unpaid(task.specification)
    model = model_of(task, unpaid)
    training = Training(make=_no_environment, steps=1, seed=0, report=lambda policy, steps: None, model=model)
    policy = build_agent(task, "best-possible").train(training)
    assert isinstance(policy, StatePolicy)
    acting = policy.episode()

    def act(simulator: Simulator) -> Array:
        chosen = acting(simulator.state, simulator.t, simulator.memory)
        assert isinstance(task.actions, ActionGrid)
        vectors: Array = task.actions.vectors[chosen]
        return vectors

    return actions_of(task, begun, act)


def learned(task: Task, begun: Array, folder: Path) -> list[Array]:
    """The actions of the selected policies of the task's cells, (N, decisions, axes) each."""
    cells = [each for each in Results.load(folder) if each.id.task == task.choice and each.measurement]
    return [_of_policy(*load_policy(folder, each), begun) for each in cells]


def _of_policy(task: Task, method: RewardMethod, policy: Policy, begun: Array) -> Array:
    def act(simulator: Simulator) -> Array:
        chosen = policy.act(simulator.observe())
        return task.actions.vectors[chosen] if isinstance(task.actions, ActionGrid) else chosen

    return actions_of(task, begun, act, method)


def _no_environment(count: int) -> Environment:
    raise AssertionError("a plan steps no environment")


def bound_by_start(task: Task) -> float:
    """The mean over the report's starts of the most that is possible after sample 0, within the signals' ranges."""
    begun = task.starts.report_and_selection()[0]
    simulator = Simulator(task, Unpaid(task.specification))
    simulator.reset(begun)
    whole = np.repeat(simulator.signals[:, None], task.file.steps + 1, axis=1)
    traces = without_end(whole, np.zeros(len(begun), dtype=np.int64))
    return float(judge(task.formula, traces, task.specification, "interval").robustness[:, 1].mean())


def main() -> None:
    """Search, keep what was found where it is better, and print the number."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task")
    parser.add_argument("--seconds", type=float, default=240.0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plan", action="store_true")
    parser.add_argument("--policies", type=Path)
    said = parser.parse_args()
    task = load_task(said.task)
    begun = task.starts.report_and_selection()[0]
    print(f"{task.name}: at most {bound_by_start(task):.5f} by the starts and the signals' ranges")
    zero = np.tile(baselines.zero(task), (len(begun), task.file.decisions, 1))
    found = [zero, by_hand(task, begun), *driven(task, begun)]
    found += [each for each in (kept(task), planned(task, begun) if said.plan else None) if each is not None]
    found += learned(task, begun, said.policies) if said.policies else []
    values = np.stack([robustness_of(task, begun, each) for each in found])
    print("to begin with:", ", ".join(f"{value.mean():.5f}" for value in values))
    best = np.stack(found)[values.argmax(axis=0), np.arange(len(begun))]
    best = search(task, begun, best, said.seconds, said.seed).astype(np.float32)
    FOLDER.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(FOLDER / f"{task.name}.npz", actions=best)
    score = replay(task, best.astype(np.float64))
    print(f"{task.name}: {score.mean:.6f}, worst start {score.minimum:.6f}, satisfied {100 * score.satisfaction:.1f} %")


if __name__ == "__main__":
    main()
