"""Search for what is best known of a task: one sequence of held actions for each of the report's starts.

    python studies/best_known.py TASK [--seconds 240] [--plan] [--policies FOLDER]

For each start it begins with the best of these: the action zero, the controller by hand, a drive along way points where
the task has some here, the sequences that were found before, with `--plan` a plan for the formula, and with
`--policies` what each selected policy of a folder of results does. It changes sequences at random and keeps a change
that does not make the robustness of its start smaller. The sequences go to results/best-known/TASK.npz, where anybody
can replay them (`replay`). The number itself stands in the task file, under `best_known`.

This is meant for systems without noise: a sequence that was made for one course of the noise is no policy.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np

from stlbench.contract import (
    ActionGrid,
    Actions,
    Array,
    Environment,
    Integers,
    Policy,
    RewardMethod,
    StatePolicy,
    Training,
)
from stlbench.records.result import Score
from stlbench.rollout import baselines, controller, referee
from stlbench.rollout.controller import Unpaid, nearest
from stlbench.rollout.early_ends import judge, without_end
from stlbench.rollout.environment import Simulator
from stlbench.rollout.model import model_of
from stlbench.study.policies import load_policy
from stlbench.study.results import Results
from stlbench.task import Task, build_agent, load_task
from stlbench_tasks.steering import Steering

FOLDER = Path(__file__).resolve().parent.parent / "results" / "best-known"
_TRIES = 16
"""Changed sequences of each start that are simulated side by side."""
_SHIFTED, _NEAR, _UNDONE = 0.15, 0.5, 0.7
"""How often a change shifts; has its two places near each other; and takes back what it adds."""
_WAYS = {"overlap": ((1.1, 1.25), (2.75, 1.25), (3.0, 1.0), (2.75, 1.25), (0.8, 1.25), (0.8, 2.75), (1.0, 3.0))}
"""Task -> way points x, y of a differential-drive robot."""
_AHEAD, _SPEEDS, _NEAR_POINT = (0.08, 0.12, 0.18, 0.25), (0.5, 0.7, 1.0), (0.02, 0.04)
"""How far ahead on the line it aims, in m; shares of the greatest speed; and how near a way point counts, in m."""
_SAY = 20.0
"""CPU seconds from one line to the next."""


def replay(task: Task, sequences: Array) -> Score:
    """The referee's score when the report's starts (N, s) are given the held actions (N, decisions, axes)."""
    return referee.score(task, _traces(task, task.starts.report_and_selection()[0], sequences))


def kept(task: Task) -> Array | None:
    """The sequences (N, decisions, axes) in the folder; None where there are none."""
    path = FOLDER / f"{task.name}.npz"
    return np.load(path)["actions"].astype(np.float64) if path.exists() else None


def _traces(task: Task, begun: Array, sequences: Array) -> Array:
    """Those (N, T + 1, k) that the sequences (N, decisions, axes) lead to."""
    return controller.replay(task, taken(task, sequences), begun).traces


def taken(task: Task, vectors: Array) -> Integers | Array:
    """Actions (..., axes) as the task takes them: on a grid the places (...) of the nearest ones."""
    if not isinstance(task.actions, ActionGrid):
        return vectors
    return nearest(task.actions, vectors.reshape(-1, vectors.shape[-1])).reshape(vectors.shape[:-1])


def robustness_of(task: Task, begun: Array, sequences: Array) -> Array:
    """What the referee's score has (N,), without the time that its other numbers take."""
    traces = _traces(task, begun, sequences)
    robustness: Array = judge(task.formula, traces, task.specification, task.file.terminated).robustness[:, 0]
    return robustness


def by_hand(task: Task, begun: Array) -> Array:
    """What the controller does from the starts, (N, decisions, axes); the action zero where there is none."""
    zero = baselines.zero(task)

    def act(simulator: Simulator) -> Array:
        vectors = simulator.world.by_hand(simulator.t)
        return np.tile(zero, (len(begun), 1)) if vectors is None else np.asarray(vectors, dtype=np.float64)

    return actions_of(task, begun, act)


def driven(task: Task, begun: Array) -> list[Array]:
    """What a robot does that drives along the task's way points, in several manners, (N, decisions, axes) each."""
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
    """What the policy of a plan for the formula does, (N, decisions, axes)."""
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
    """What the selected policies of the task's cells do, (N, decisions, axes) each."""
    cells = [each for each in Results.load(folder) if each.id.task == task.choice and each.measurement]
    return [_of_policy(*load_policy(folder, each), begun) for each in cells]


def _of_policy(task: Task, method: RewardMethod, policy: Policy, begun: Array) -> Array:
    def act(simulator: Simulator) -> Array:
        chosen = policy.act(simulator.observe())
        return task.actions.vectors[chosen] if isinstance(task.actions, ActionGrid) else chosen

    return actions_of(task, begun, act, method)


def _no_environment(count: int) -> Environment:
    raise AssertionError("a plan steps no environment")


def actions_of(
    task: Task, begun: Array, act: Callable[[Simulator], Array], method: RewardMethod | None = None
) -> Array:
    """The held actions (N, decisions, axes) of what acts, by the inputs of a method."""
    acted = list[Array]()

    def recording(simulator: Simulator) -> Integers | Array:
        acted.append(np.clip(act(simulator), task.actions.low, task.actions.high))
        return taken(task, acted[-1])

    referee.simulate(task, method or Unpaid(task.specification), recording, begun)
    return np.stack(acted, axis=1)


def search(task: Task, begun: Array, sequences: Array, seconds: float, seed: int = 0) -> Array:
    """Sequences (N, decisions, axes) that are no worse from any of the starts, after so many CPU seconds."""
    generator, clock = np.random.default_rng(seed), time.process_time
    best, end, said = robustness_of(task, begun, sequences), clock() + seconds, clock()
    rows = np.arange(len(begun))
    while clock() < end:
        tried = _changed(np.repeat(sequences, _TRIES, axis=0), task.actions, generator)
        found = robustness_of(task, np.repeat(begun, _TRIES, axis=0), tried).reshape(len(begun), _TRIES)
        winner = found.argmax(axis=1)
        better = found[rows, winner] >= best
        winners = tried.reshape(len(begun), _TRIES, *tried.shape[1:])[rows, winner]
        sequences = np.where(better[:, None, None], winners, sequences)
        best = np.where(better, found[rows, winner], best)
        if clock() - said > _SAY:
            said = clock()
            print(f"{end - said:6.0f} s left, {best.mean():.5f}, worst start {best.min():.5f}", flush=True)
    return sequences


def _changed(sequences: Array, actions: Actions, generator: np.random.Generator) -> Array:
    """Each of the sequences (N, decisions, axes) changed, mostly so that what follows is moved and not turned.

    Either all actions between two decisions come one decision sooner or later; or one axis has more for some decisions,
    and most often as much less for as many others.
    """
    count, decisions, axes = sequences.shape
    rows, places = np.arange(count), np.arange(decisions)[None]
    first, second = generator.integers(decisions, size=(2, count, 1))
    shifted = generator.random((count, 1)) < _SHIFTED
    low, high = np.minimum(first, second), np.maximum(first, second) + 1
    sooner = low + (places - low + generator.choice((-1, 1), (count, 1))) % (high - low)
    moved = shifted & (places >= low) & (places < high)
    changed: Array = sequences[rows[:, None], np.where(moved, sooner, places)]
    axis, length = generator.integers(axes, size=count), 1 + generator.exponential(1.0, (count, 1)).astype(np.int64)
    near = generator.random((count, 1)) < _NEAR
    second = np.where(near, np.maximum(first + generator.integers(-8, 9, (count, 1)), 0), second)
    lower, upper = np.array(actions.low), np.array(actions.high)
    span = (upper - lower)[axis]
    if isinstance(actions, ActionGrid):
        steps = generator.choice((-1, 1), count) * generator.choice((1, 1, 2, 3), count)
        change = steps * span / (np.array(actions.shape)[axis] - 1)
    else:
        change = span * generator.normal(size=count) * 10 ** generator.uniform(-3, -0.5, count)
    undone = generator.random((count, 1)) < _UNDONE
    more = ((places >= first) & (places < first + length)).astype(np.float64)
    more -= undone & (places >= second) & (places < second + length)
    changed[rows, :, axis] += np.where(shifted, 0.0, change[:, None] * more)
    return np.clip(changed, lower, upper)


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
    zero = np.tile(baselines.zero(task), (len(begun), task.file.steps // task.file.hold, 1))
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
