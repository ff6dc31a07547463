"""Tasks by their names: `unicycle/sequence/7` is the seventh accepted candidate of its system and template."""

import json
from collections.abc import Mapping, Sequence
from functools import cache, cached_property
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract import Integers, Suite, SuiteScores, SuiteTask
from stlbench_tasks.suite.systems import SYSTEMS, About
from stlbench_tasks.suite.templates import (
    DT,
    TEMPLATES,
    Draw,
    Level,
    Scene,
    avoid_reach,
    deliver,
    either_or,
    patrol,
    patrol_stay,
    response,
    tube,
    until,
)

TIERS = {"near": 4.0, "middle": 7.0, "far": float("inf")}
"""Tier -> the distance below which a task is in it. The numbers part the tasks of the suite into thirds, about."""


def distance(facts: Mapping[str, Any]) -> float:
    """How much more robustness the witness has than the best baseline, in units of the witness's own robustness.

    The baselines are the action zero, the best constant action and random actions. 1 would be a baseline that just
    satisfies.
    """
    witness = facts["robustness"]
    best = max(score["robustness"] for score in facts["baselines"].values())
    return float((witness - best) / witness)


def tier(facts: Mapping[str, Any]) -> str:
    """The tier of a task."""
    return next(name for name, end in TIERS.items() if distance(facts) < end)


VERSION = 1
"""A change of what a name means is a suite of another name."""
SPLITS = ("dev", "core", "core", "hard")
"""The split of task n of its system and template; that of later ones is `fresh`."""
QUICK = 24
"""Tasks of the split `quick`, evenly spread over the first core tasks of all systems and templates."""
_OF_ONE = (either_or, until, patrol, patrol_stay, response, tube)
"""Templates for systems of one point."""
STARTS = 32
"""Starts of the report, and of a witness."""


def fits(system: str, template: str) -> bool:
    """Whether a template makes sense for a system."""
    points, form = SYSTEMS[system].about.points, TEMPLATES[template]
    if len(points) > 1:
        return form not in _OF_ONE
    return form is not deliver and (form is not avoid_reach or len(points[0]) > 1)


class Candidate(NamedTuple):
    """A candidate that may become a task."""

    system: str
    template: str
    level: Level
    number: int

    @property
    def scene(self) -> tuple[Scene, str]:
        """The scene and the formula. Raises `Cramped`."""
        name = f"{VERSION}/{self.system}/{self.template}/{self.level}/{self.number}"
        scene = Scene(SYSTEMS[self.system], Draw(name), self.level)
        return scene, TEMPLATES[self.template](scene)

    def content(self, title: str) -> dict[str, Any]:
        """The entries of its `task.yaml`. Raises `Cramped`."""
        scene, formula = self.scene
        system, about = scene.system, scene.system.about
        return {
            "title": title,
            "source": f"stlbench's suite of formulas, version {VERSION}: {TEMPLATES[self.template].__doc__}",
            "formula": formula,
            "sampling_time": DT,
            "steps": -(-stl.horizon(stl.parse(formula)) // about.hold) * about.hold,
            "hold": about.hold,
            "signals": {
                name: dict(zip(("low", "high", "unit"), ends, strict=True)) for name, ends in about.ranges.items()
            },
            "plane": list(about.points[0]) if len(about.points[0]) > 1 else None,
            "actions": {
                name: dict(zip(("low", "high", "count", "unit"), axis, strict=True))
                for name, axis in about.axes.items()
            },
            "robots": {name: list(owned) for name, owned in about.robots.items()},
            "initial": {"box": {name: list(ends) for name, ends in system.begin(tuple(scene.starts)).items()}},
            "starts": STARTS,
            "budgets": _budgets(about),
        }


def _budgets(about: About) -> dict[str, dict[str, int]]:
    quick = about.decisions * about.hold
    return {
        "smoke": {"steps": 3200 * about.hold, "seeds": 1, "deadline": 300, "checkpoints": 1, "random_starts": 0},
        "quick": {"steps": quick, "seeds": 2, "deadline": 3600, "checkpoints": 10, "random_starts": 200},
        "paper": {"steps": 4 * quick, "seeds": 10, "deadline": 3600},
    }


@cache
def table() -> Mapping[str, Any]:
    """Candidates accepted by `studies/suite.py`: system/template -> a row per task, with the facts that it measured."""
    return _stored("accepted.json", {"accepted": {}, "refused": {}})


def _stored(name: str, otherwise: Mapping[str, Any]) -> Mapping[str, Any]:
    path = resources.files(__package__).joinpath(name)
    return dict(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else otherwise


def level(n: int) -> Level:
    """The level at which task n is drawn."""
    return "hard" if _split(n) == "hard" else "usual"


class FormulaSuite(Suite):
    """Generated formulas on simple systems, each with a witness and an upper bound, for the track auto."""

    @cached_property
    def names(self) -> Sequence[str]:
        """system/template/n."""
        return [f"{pair}/{n}" for pair, rows in table()["accepted"].items() for n in range(len(rows))]

    @cached_property
    def splits(self) -> Mapping[str, Sequence[str]]:
        """The split by the number of a task: dev 0; core 1, 2; hard 3; fresh 4, 5, ...; quick, a part of core."""
        own = {name: _split(int(name.rpartition("/")[2])) for name in self.names}
        parts = {split: [name for name in own if own[name] == split] for split in dict.fromkeys((*SPLITS, "fresh"))}
        first = [name for name in self.names if name.endswith("/1")]
        spread = np.unique(np.arange(QUICK) * len(first) // QUICK) if first else ()
        return parts | {"quick": [first[place] for place in spread]}

    def task(self, name: str) -> SuiteTask:
        """The task, with its best known robustness and its baselines."""
        candidate, facts = self.candidate(name), self.facts(name)
        best = {key: facts[key] for key in ("robustness", "upper_bound")}
        why = {
            "how": "the witness: way points, a gradient, local search",
            "why": "what the points can reach, predicate by predicate",
        }
        known = {"best_known": best | why, "baselines": facts["baselines"]}
        return SuiteTask(SYSTEMS[candidate.system], json.dumps(candidate.content(f"suite:{name}") | known))

    def groups(self, name: str) -> Mapping[str, str]:
        """Its system, its template, and its tier: how far the baselines stay from the witness."""
        system, template, _ = name.split("/")
        return {"system": system, "template": template, "tier": tier(self.facts(name))}

    def candidate(self, name: str) -> Candidate:
        """The candidate that a name stands for."""
        system, template, n = name.split("/")
        return Candidate(system, template, level(int(n)), self.facts(name)["candidate"])

    def facts(self, name: str) -> Mapping[str, Any]:
        """The facts that were measured of a task."""
        pair, _, n = name.rpartition("/")
        return dict(table()["accepted"][pair][int(n)])

    def witness(self, name: str) -> Integers | None:
        """The best actions that were found from each of the report's starts."""
        with resources.files(__package__).joinpath("witnesses.npz").open("rb") as file, np.load(file) as stored:
            return stored[name].astype(np.int64) if name in stored else None

    def scores(self) -> Sequence[SuiteScores]:
        """The answers that `studies/suite_answers.py` took from the committed studies."""
        return [SuiteScores(**each) for each in _stored("scores.json", {}).values()]


def _split(n: int) -> str:
    return SPLITS[n] if n < len(SPLITS) else "fresh"
