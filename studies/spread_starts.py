"""Whether one schedule serves starts all over the room, or those nearest to each order of the goals need their own.

python studies/spread_starts.py make DIR     write a task for each variant, and one for the starts of each order
(cd DIR && stlbench run --tasks "$(ls -d ./*-? | paste -sd,)" --methods raw --seeds 100-101 --track auto)
python studies/spread_starts.py table DIR    print what is learned
"""

from __future__ import annotations

import csv
import json
import re
import sys
from collections import defaultdict
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from recorded import markdown

from stlbench import stl
from stlbench.records.result import LEARNED
from stlbench.stl import Eventually
from stlbench.stl.language.structure import walk
from stlbench.task.entry import Region
from stlbench_tasks.suite.formulas import FormulaSuite
from stlbench_tasks.suite.scene import DT, Disc, Scene
from stlbench_tasks.suite.systems import SYSTEMS

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
POINTS = np.random.default_rng(0).uniform(EDGE, 6 - EDGE, (100_000, 2))
SYSTEM = '''"""The suite's system, with starts elsewhere."""

from stlbench_tasks.suite.systems import {0}


class Spread({0}):
    __doc__ = {0}.__doc__
'''


def _rests(scene: Scene, patrol: bool) -> dict[Disc, float]:
    """The first goals of all orders, each with the seconds from there to the last goal."""
    found = dict[Disc, float]()
    for tour in scene.tours or [scene.regions[:1]]:
        legs = [np.subtract(one.centre, other.centre) for one, other in pairwise(tour[:2] if patrol else tour)]
        rest = sum(float(np.hypot(*leg)) / scene.about.pace + scene.about.settle for leg in legs)
        found[tour[0]] = min(rest, found.get(tour[0], np.inf))
    return found


def _from(goal: Disc) -> str:
    return f"norm(x - {goal.centre[0]:g}, y - {goal.centre[1]:g})"


def tasks(system: str, template: str) -> Iterator[dict[str, object]]:
    """The entries of a variant's `task.yaml`, and then of the tasks for the starts that are nearest to each order."""
    plain = template.removesuffix("-tight")
    candidate = FormulaSuite().candidate(f"{system}/{plain}/0")
    content = candidate.content(f"{system}/{plain}/0, starts all over the room")
    scene, formula = candidate.scene
    rests = _rests(scene, plain == "patrol")
    deadline = next(each.b for each in walk(stl.parse(formula)) if isinstance(each, Eventually))
    if plain != template:
        formula = formula.replace(f"[0,{deadline}]", f"[0,{TIGHT[system]}]")
        deadline = content["steps"] = TIGHT[system]
    metres = [(deadline * DT / SLACK - rest - scene.about.settle) * scene.about.pace for rest in rests.values()]
    beyond = {goal: f"{_from(goal)} - ({left:.4f})" for goal, left in zip(rests, metres, strict=True)}
    clear = [f"{_from(each)} >= {each.radius + EDGE:g}" for each in scene.obstacles]
    kept = [*clear, "(" + " | ".join(f"{each} <= 0" for each in beyond.values()) + ")"]
    box = content["initial"]["box"] | {"x": [EDGE, 6 - EDGE], "y": [EDGE, 6 - EDGE]}
    yield content | {"formula": formula, "initial": {"box": box, "where": " & ".join(kept)}}
    for goal, own in beyond.items() if len(beyond) > 1 else ():
        others = [each for each in beyond if each is not goal]
        where = " & ".join([*kept, *(f"{own} <= {beyond[each]}" for each in others)])
        one = formula
        if plain == "either-or":  # without the other goal
            one = re.sub(rf"( \| )?G\[0,\d+\] {re.escape(str(others[0]))}( \| )?", "", formula)
        yield content | {"formula": one, "initial": {"box": box, "where": where}}


def make(folder: Path) -> None:
    """Write the folders of all tasks."""
    for template, systems in VARIANTS.items():
        for system in systems:
            for number, content in enumerate(tasks(system, template)):
                task = folder / f"{system}-{template}-{number}"
                task.mkdir(parents=True, exist_ok=True)
                (task / "task.yaml").write_text(json.dumps(content, indent=1))
                (task / "system.py").write_text(SYSTEM.format(SYSTEMS[system].__name__))


def _share(task: Path) -> float:
    """Of the room, the share in which a task's starts lie."""
    where = json.loads((task / "task.yaml").read_text())["initial"]["where"]
    room = Region.model_validate({"box": {"x": [0, 6], "y": [0, 6]}, "where": where})
    return len(room.keep(POINTS)) / len(POINTS)


def table(folder: Path) -> str:
    """For each variant what one schedule satisfies, and those of the orders, weighted by their shares of the starts."""
    found = defaultdict[str, dict[tuple[str, int], float]](dict)
    with (folder / "results" / "cells.csv").open(newline="") as file:
        for row in csv.DictReader(file):
            variant, _, number = Path(row["task"]).name.rpartition("-")
            if row["status"] == "done":
                found[variant][row["seed"], int(number)] = float(row["satisfaction"])
    seeds = sorted({seed for own in found.values() for seed, _ in own})
    body = []
    for variant, own in found.items():
        room, *shares = (_share(path) for path in sorted(folder.glob(f"{variant}-?")))
        body.append([variant, f"{room:.0%}", str(max(1, len(shares)))])
        for seed in seeds:
            of_groups = [own.get((seed, number), np.nan) for number in range(1, len(shares) + 1)]
            several = np.average(of_groups, weights=shares) if shares else np.nan
            body[-1] += [_told(own.get((seed, 0), np.nan)), _told(float(several))]
    heads = [f"{each}, seed {seed}" for seed in seeds for each in ("one", "several")]
    return markdown(["variant", "of the room", "orders", *heads], body, right=2 + len(heads))


def _told(share: float) -> str:
    return "not run" if np.isnan(share) else f"{share:.1%}" + " !" * (share < LEARNED)


if __name__ == "__main__":
    command, target = sys.argv[1:]
    make(Path(target)) if command == "make" else print(table(Path(target)))
