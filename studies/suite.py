"""Make the suite: accept candidates, search for their witnesses, and write what `stlbench_tasks.suite` reads.

    python studies/suite.py [--systems unicycle,pair] [--count 4] [--seconds 4]

For each system and template it tries candidates in turn until `count` are accepted. It refuses a candidate

- `cramped`: that has no place for its regions;
- `trivial`: that the zero action, the best constant action or random actions satisfy from more than 5 % of the starts;
- `twin`: that has the same formula and starts as another;
- `unknown`: for which it finds no witness that satisfies from all starts.

A witness is a drive along way points, whose details are drawn at random and selected (the cross-entropy method),
followed by the local search over held actions of `best_known.py`. What is there already is kept: the same command goes
on where it was interrupted.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from best_known import _recorded, _robustness, replay, search
from scipy import linalg

import stlbench_tasks.suite
from stlbench import stl
from stlbench.contract import ActionGrid, Array
from stlbench.registry.choices import Choice
from stlbench.rollout import baselines
from stlbench.rollout.controller import nearest
from stlbench.rollout.environment import Simulator
from stlbench.task import Task
from stlbench.task.reading import read_task_file
from stlbench.task.windows import Window, with_parts
from stlbench_tasks.steering import Steering
from stlbench_tasks.suite.formulas import Candidate, fits, level
from stlbench_tasks.suite.scene import DT, Cramped, Disc, Scene
from stlbench_tasks.suite.systems import SYSTEMS, Arm, CartPendulum, DoubleIntegrator, Quadrotor, SuiteSystem, Unicycle
from stlbench_tasks.suite.templates import TEMPLATES

FOLDER = Path(stlbench_tasks.suite.__file__).parent
TABLE, WITNESSES = FOLDER / "accepted.json", FOLDER / "witnesses.npz"
TRIVIAL, PATIENCE = 0.05, 60
"""The share of starts that is trivial to satisfy, and how many candidates in a row may be refused."""
_DRIVES, _ELITE, _ROUNDS = 48, 6, 8
"""Drives from each start that are tried at once, those of them that are kept, and how often."""


def load(candidate: Candidate) -> tuple[Task, Scene]:
    """A candidate as a task, and its scene. Raises `Cramped`."""
    content = candidate.content(f"{candidate.system}/{candidate.template}")
    file = read_task_file(json.dumps(content), "candidate")
    return Task(Choice("candidate"), file, SYSTEMS[candidate.system](file.sampling_time)), candidate.scene[0]


# ------------------------------------------------------------------------------------------------------- upper bound


def upper_bound(task: Task, system: type[SuiteSystem]) -> float:
    """The mean over the report's starts of more robustness than any actions have.

    The margin of a part without temporal operators changes by at most the way of each point that it reads. So within t
    seconds it is at most its value at the start, plus the farthest way, and never more than its greatest value. The
    formula, read on these bounds, bounds its robustness, as it falls with none of the margins.
    """
    begun = task.starts.report_and_selection()[0]
    signals, steps = task.system.signals(begun), task.file.steps
    way = system.about.farthest(task.file.sampling_time * np.arange(steps + 1))
    box = {name: (low - way[-1] - 1, high + way[-1] + 1) for name, (low, high) in task.file.box.items()}
    traces = list[Array]()

    def part(window: Window) -> stl.Formula:
        read = set(stl.signals(window.psi))
        moving = [names for names in system.about.points if not read.isdisjoint(names)]
        most = np.full((len(begun), steps + 1), stl.bounds(window.psi, box, tolerance=1e-3, nodes=500).high)
        at_start = stl.margin(window.psi, task.signals)(signals)
        if read == set().union(*moving):
            most = np.minimum(most, at_start[:, None] + len(moving) * way)
        most[:, 0] = at_start
        traces.append(most)
        return stl.parse(f"p{len(traces)} >= 0")

    formula = with_parts(task.formula, part)
    names = [f"p{i + 1}" for i in range(len(traces))]
    return float(stl.robustness(formula, np.stack(traces, axis=-1), names).mean())


# ----------------------------------------------------------------------------------------------------------- witness


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

        return _recorded(self.task, self.begun, act)

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
    step = 1e-6
    rest, step = np.zeros((1, 1)), 1e-6 * np.eye(4)[:, None]
    around = [(system.step(one, rest) - system.step(-one, rest)) / 2e-6 for one in step]
    a, b = np.concatenate(around).T, system.step(np.zeros((1, 4)), np.ones((1, 1))).T
    p = linalg.solve_discrete_are(a, b, np.diag([3.0, 1.0, 10.0, 1.0]), np.eye(1))
    gain: Array = np.linalg.solve(np.eye(1) + b.T @ p @ b, b.T @ p @ a)
    return gain


def witness(task: Task, scene: Scene, seconds: float) -> Array:
    """Actions (starts, decisions, axes) of the grid, the best that were found in about so many seconds."""
    drives, generator = Drives(task, scene), np.random.default_rng(0)
    begun = task.starts.report_and_selection()[0]
    starts, shape = len(begun), (len(begun), _DRIVES, drives.legs, 5)
    mean, spread = np.zeros((starts, 1, *shape[2:])), np.ones((starts, 1, *shape[2:]))
    best, robustness = (
        np.zeros((starts, task.file.steps // task.file.hold, len(task.actions.names))),
        np.full(starts, -np.inf),
    )
    tours = generator.integers(len(drives.tours), size=shape[:2])
    for round_ in range(_ROUNDS):
        numbers = mean + spread * generator.normal(size=shape)
        actions = drives(numbers.reshape(-1, *shape[2:]), tours.ravel())
        found = _robustness(task, drives.begun, actions).reshape(shape[:2])
        order = np.argsort(-found, axis=1)
        top = np.take_along_axis(found, order[:, :1], axis=1)[:, 0]
        better = top > robustness
        best[better] = actions.reshape(*shape[:2], *actions.shape[1:])[np.arange(starts), order[:, 0]][better]
        robustness[better] = top[better]
        if round_:  # the first drives choose the tours
            elite = np.take_along_axis(numbers, order[:, :_ELITE, None, None], axis=1)
            mean, spread = elite.mean(axis=1, keepdims=True), elite.std(axis=1, keepdims=True) + 0.1
        tours = np.broadcast_to(np.take_along_axis(tours, order[:, :1], axis=1), shape[:2])
    if robustness.min() < -0.3:  # hopeless
        return best
    assert isinstance(task.actions, ActionGrid)
    return search(
        task,
        begun,
        task.actions.vectors[nearest(task.actions, best.reshape(-1, best.shape[-1]))].reshape(best.shape),
        seconds,
    )


# --------------------------------------------------------------------------------------------------------- acceptance


def judged(candidate: Candidate, others: list[tuple[str, str]], seconds: float) -> tuple[dict[str, Any], Array] | str:
    """The row of the table and the witness (starts, decisions) as indices; why it is refused instead."""
    try:
        task, scene = load(candidate)
    except Cramped:
        return "cramped"
    if _asked(candidate) in others:
        return "twin"
    constants, random = baselines.constants(task), baselines.at_random(task)
    if max(constants.zero.satisfaction, constants.best.satisfaction, random.satisfaction) > TRIVIAL:
        return "trivial"
    actions = witness(task, scene, seconds)
    score = replay(task, actions)
    if score.satisfaction < 1:
        return "unknown"
    assert isinstance(task.actions, ActionGrid)
    indices = nearest(task.actions, actions.reshape(-1, actions.shape[-1])).reshape(actions.shape[:2])
    scores = {"zero": constants.zero, "constant": constants.best, "random": random}
    rows: dict[str, Any] = {
        name: {"robustness": round(each.mean, 5), "satisfied": each.satisfaction} for name, each in scores.items()
    }
    rows["constant"]["action"] = list(constants.action)
    bound = upper_bound(task, SYSTEMS[candidate.system])
    row = {"candidate": candidate.number, "robustness": round(score.mean, 5), "upper_bound": round(bound, 5)}
    return {**row, "baselines": rows}, indices.astype(np.min_scalar_type(task.actions.size - 1))


def main() -> None:
    """Go on until each system and template has so many tasks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--systems", default=",".join(SYSTEMS))
    parser.add_argument("--count", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=4.0)
    options = parser.parse_args()
    table: dict[str, Any] = {"accepted": {}, "refused": {}, "short": []}
    stored = dict[str, Array]()
    if TABLE.exists():
        table = json.loads(TABLE.read_text(encoding="utf-8"))
        stored = dict(np.load(WITNESSES))
    for template in TEMPLATES:
        for system in options.systems.split(","):
            if fits(system, template):
                fill(system, template, options.count, options.seconds, table, stored)


def fill(
    system: str, template: str, size: int, seconds: float, table: dict[str, Any], stored: dict[str, Array]
) -> None:
    """Accept tasks of one system and template until there are so many, or too many are refused; write each at once."""
    pair = f"{system}/{template}"
    rows, refused = table["accepted"].setdefault(pair, []), Counter(table["refused"].setdefault(pair, {}))
    while len(rows) < size and pair not in table["short"]:
        own = level(len(rows))
        tried = [row["candidate"] for n, row in enumerate(rows) if level(n) == own]
        twins = [_asked(Candidate(system, template, own, number)) for number in tried]
        first = max(tried, default=-1) + 1
        for number in range(first, first + PATIENCE):
            result = judged(Candidate(system, template, own, number), twins, seconds)
            if not isinstance(result, str):
                break
            refused[result] += 1
        table["refused"][pair] = dict(refused)
        if isinstance(result, str):
            table["short"].append(pair)
            print(f"{pair}: only {len(rows)}; refused {dict(refused)}", flush=True)
            break
        row, indices = result
        stored[f"{pair}/{len(rows)}"] = indices
        rows.append(row)
        print(f"{pair}/{len(rows) - 1}: {row['robustness']:.3f} of {row['upper_bound']:.3f}", flush=True)
        write(table, stored)
    write(table, stored)


def _asked(candidate: Candidate) -> tuple[str, str]:
    """What makes two tasks the same. Raises `Cramped`."""
    content = candidate.content("")
    return content["formula"], str(content["initial"])


def write(table: dict[str, Any], stored: dict[str, Array]) -> None:
    """Write the table, a line for each task, and the witnesses."""
    pairs = {pair: ",\n".join(f"   {json.dumps(row)}" for row in rows) for pair, rows in table["accepted"].items()}
    accepted = ",\n".join(f'  "{pair}": [\n{rows}\n  ]' for pair, rows in pairs.items())
    refused = ",\n".join(f'  "{pair}": {json.dumps(counts)}' for pair, counts in table["refused"].items())
    short = json.dumps(table["short"])
    text = f'{{\n "accepted": {{\n{accepted}\n }},\n "refused": {{\n{refused}\n }},\n "short": {short}\n}}\n'
    TABLE.write_text(text, encoding="utf-8")
    np.savez_compressed(WITNESSES, **stored)  # type: ignore[arg-type]


if __name__ == "__main__":
    main()
