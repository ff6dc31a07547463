"""Whether one schedule serves starts all over the room: what it satisfies, by the order that is nearest to a start.

python studies/spread_starts.py make DIR     write a task for each variant
(cd DIR && stlbench run --tasks "$(ls -d ./*-0 | paste -sd,)" --methods raw --seeds 100-101 --track auto)
python studies/spread_starts.py table DIR    let the trained policies act from other starts, and print the table
"""

from __future__ import annotations

import json
import os
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from recorded import markdown

from stlbench import stl
from stlbench.records import results_folder
from stlbench.simulation.referee import record, score
from stlbench.stl import Eventually, fragment
from stlbench.stl.language.structure import walk
from stlbench.study.policies import load_policy
from stlbench.task import load_task
from stlbench_tasks.suite.formulas import FormulaSuite
from stlbench_tasks.suite.systems import SYSTEMS
from stlbench_tasks.suite.templates import DT, Disc, Scene

MOVING = ("integrator", "double-integrator", "unicycle")
VARIANTS = {
    "free-order": MOVING,
    "patrol": MOVING,
    "either-or": ("double-integrator", "unicycle"),
    "chain": ("double-integrator",),
    "overlap": ("unicycle",),
    "free-order-tight": MOVING,
}
"""Template -> systems, with the formula of the task of the split dev; `tight`: with a deadline that leaves little."""
SLACK = 1.15
"""A start is kept from which a robot has so many times the time that it needs at the system's pace."""
TIGHT = {"integrator": 100, "double-integrator": 200, "unicycle": 150}
"""The deadline in steps that leaves so much time from 95 % of the room, in the best order."""
EDGE = 0.1
"""Metres from walls and obstacles."""
STARTS = 2000
NAMES = [(system, template, f"{system}-{template}-0") for template, systems in VARIANTS.items() for system in systems]
SYSTEM = '''"""The suite's system, with starts elsewhere."""

from stlbench_tasks.suite.systems import {0}


class Spread({0}):
    __doc__ = {0}.__doc__
'''


def rests(scene: Scene, patrol: bool) -> dict[Disc, float]:
    """The first goals of all orders, each with the seconds from there to the last goal."""
    found = dict[Disc, float]()
    for tour in scene.tours or [scene.regions[:1]]:
        legs = [np.subtract(one.centre, other.centre) for one, other in pairwise(tour[:2] if patrol else tour)]
        rest = sum(float(np.hypot(*leg)) / scene.about.pace + scene.about.settle for leg in legs)
        found[tour[0]] = min(rest, found.get(tour[0], np.inf))
    return found


def content(system: str, template: str) -> dict[str, object]:
    """The entries of a variant's `task.yaml`."""
    plain = template.removesuffix("-tight")
    candidate = FormulaSuite().candidate(f"{system}/{plain}/0")
    entries = candidate.content(f"{system}/{plain}/0, starts all over the room")
    scene, formula = candidate.scene
    deadline = next(each.b for each in walk(stl.parse(formula)) if isinstance(each, Eventually))
    if plain != template:
        formula = formula.replace(f"[0,{deadline}]", f"[0,{TIGHT[system]}]")
        deadline = entries["steps"] = TIGHT[system]
    seconds = deadline * DT / SLACK - scene.about.settle
    near = [
        f"{_from(goal)} - ({(seconds - rest) * scene.about.pace:.4f}) <= 0"
        for goal, rest in rests(scene, plain == "patrol").items()
    ]
    clear = [f"{_from(each)} >= {each.radius + EDGE:g}" for each in scene.obstacles]
    box = entries["initial"]["box"] | {"x": [EDGE, 6 - EDGE], "y": [EDGE, 6 - EDGE]}
    where = " & ".join([*clear, "(" + " | ".join(near) + ")"])
    return entries | {"formula": formula, "initial": {"box": box, "where": where}}


def _from(goal: Disc) -> str:
    return f"norm(x - {goal.centre[0]:g}, y - {goal.centre[1]:g})"


def make(folder: Path) -> None:
    """Write the folders of all tasks."""
    for system, template, name in NAMES:
        (folder / name).mkdir(parents=True, exist_ok=True)
        (folder / name / "task.yaml").write_text(json.dumps(content(system, template), indent=1))
        (folder / name / "system.py").write_text(SYSTEM.format(SYSTEMS[system].__name__))


def table() -> str:
    """For each variant and seed the share of starts that is satisfied: of all, and of those nearest to each order."""
    body = []
    for system, template, name in NAMES:
        load_task(f"./{name}")  # the policies' own tasks are found by name from now on
        plain = template.removesuffix("-tight")
        scene, _ = FormulaSuite().candidate(f"{system}/{plain}/0").scene
        ways = rests(scene, plain == "patrol")
        for result in results_folder.read(Path("results")):
            if Path(str(result.id.task)).name != name or result.measurement is None:
                continue
            kept = load_policy(Path("results"), result, "selected")
            starts = kept.task.starts.of_training(np.random.default_rng(7), STARTS)
            played = record(kept.task, kept.method, kept.policy, starts)
            satisfied = np.array(score(kept.task, played.traces).satisfied)
            costs = [np.hypot(*(starts[:, :2] - g.centre).T) / scene.about.pace + rest for g, rest in ways.items()]
            nearest, schedule = np.argmin(costs, axis=0), kept.task.file.schedule
            first = "" if schedule is None else str(fragment(schedule)[0].psi)
            shares = [f"{satisfied[nearest == i].mean():.1%}{' *' * (str(g) == first)}" for i, g in enumerate(ways)]
            body.append([name, str(result.id.seed), f"{satisfied.mean():.1%}", ", ".join(shares)])
    return markdown(["variant", "seed", "all starts", "nearest to each order; * that of the schedule"], body, right=2)


if __name__ == "__main__":
    command, target = sys.argv[1:]
    if command == "make":
        make(Path(target))
    else:
        os.chdir(target)
        print(table())
