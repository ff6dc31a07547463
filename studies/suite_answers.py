"""What trainings on the suite answer: what explains scores, what they depend on, whether a form tells the best method.

python studies/suite_answers.py     write the scores that `stlbench advise` reads, and print the tables
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from pathlib import Path
from statistics import fmean

import numpy as np
import page_suite
import recorded
from numpy.typing import NDArray
from recorded import markdown

from stlbench import stl
from stlbench.report import evidence
from stlbench.statistics.intervals import LEVEL
from stlbench.task.traits import traits
from stlbench_tasks import suite
from stlbench_tasks.suite.formulas import FormulaSuite

FOLDERS = ("suite-quick",)
"""Of results; a task and method in several of them has the seeds of all."""
SCORES = Path(suite.__file__).with_name("scores.json")
SHOWN = ("funnel", "raw", "flag")
"""Methods that pairs are made of."""
_RESAMPLES = 999


@dataclass(frozen=True)
class Drawn:
    """A drawn task, and the scores that methods reached on it."""

    name: str
    """system/template/n."""
    formula: stl.Formula
    scores: Mapping[str, tuple[float, ...]]
    """Method -> for each seed 0 at random, 1 at the witness."""

    @property
    def group(self) -> tuple[str, str]:
        """System and template."""
        system, template, _ = self.name.split("/")
        return system, template

    @cached_property
    def size(self) -> dict[str, float]:
        """How large the task is, and how much later than needed its deadlines are."""
        scene, _ = FormulaSuite().candidate(self.name).scene
        return {"slack": scene.slack, "horizon": stl.horizon(self.formula), "regions": len(scene.regions)}


@cache
def drawn() -> tuple[Drawn, ...]:
    """All tasks that a committed study has trained on."""
    tasks, known = dict[str, dict[str, list[float]]](), FormulaSuite()
    names = {f"suite-{name.replace('/', '-')}": name for name in known.names}
    for row in (row for folder in FOLDERS for row in recorded.table(folder, "cells")):
        if row["status"] == "done" and (row["budget"], row["track"]) == ("quick", "auto"):
            score = recorded.scored(row["task"], float(row["robustness_mean"]))
            tasks.setdefault(names[row["task"]], {}).setdefault(row["method"], []).append(round(score, 4))
    formulas = {name: stl.parse(known.candidate(name).content("")["formula"]) for name in tasks}
    return tuple(
        Drawn(name, formulas[name], {method: tuple(own) for method, own in sorted(methods.items())})
        for name, methods in sorted(tasks.items())
    )


def components() -> str:
    """One row per source of differences: its share of the variance of scores, on tasks that all three methods fit.

    Sums of squares are taken in this order, so what two sources share counts for the first. Intervals are from
    resamples of the tasks.
    """
    tasks = [task for task in drawn() if {*SHOWN} <= {*task.scores}]
    generator = np.random.default_rng(0)
    resamples = [_shares([tasks[i] for i in generator.integers(len(tasks), size=len(tasks))]) for _ in range(199)]
    found = _shares(tasks)
    ends = np.quantile([list(each.values()) for each in resamples], [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    body = [
        [source, f"{100 * share:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"]
        for (source, share), low, high in zip(found.items(), *ends, strict=True)
    ]
    return markdown(["source", "share of the variance"], body)


def _shares(tasks: Sequence[Drawn]) -> dict[str, float]:
    runs = [
        (place, method, score) for place, task in enumerate(tasks) for method in SHOWN for score in task.scores[method]
    ]
    scores = np.array([score for *_, score in runs])
    groups = [tasks[place].group for place, *_ in runs]
    sources = {
        "template": [template for _, template in groups],
        "system": [system for system, _ in groups],
        "task": [str(place) for place, *_ in runs],
        "method": [method for _, method, _ in runs],
        "method and template": [
            f"{template}/{method}" for (_, template), (_, method, _) in zip(groups, runs, strict=True)
        ],
        "method and system": [f"{system}/{method}" for (system, _), (_, method, _) in zip(groups, runs, strict=True)],
        "method and task": [f"{place}/{method}" for place, method, _ in runs],
    }
    left, columns, shares = _unexplained(scores, np.ones((len(scores), 1))), np.ones((len(scores), 1)), {}
    whole = left
    for source, labels in sources.items():
        kinds = {label: number for number, label in enumerate(dict.fromkeys(labels))}
        columns = np.hstack([columns, np.eye(len(kinds))[[kinds[label] for label in labels]]])
        rest = _unexplained(scores, columns)
        shares[source], left = (left - rest) / whole, rest
    return shares | {"seed": left / whole}


def _unexplained(scores: NDArray[np.float64], columns: NDArray[np.float64]) -> float:
    fitted = columns @ np.linalg.lstsq(columns, scores, rcond=None)[0]
    return float(((scores - fitted) ** 2).sum())


def slopes() -> str:
    """One row per pair of methods: how the difference of their scores goes with the size of the task."""
    body = []
    for one, other in combinations(SHOWN, 2):
        both = [task for task in drawn() if {one, other} <= {*task.scores}]
        differences = np.array([fmean(task.scores[one]) - fmean(task.scores[other]) for task in both])
        sizes = {name: np.array([task.size[name] for task in both]) for name in both[0].size}
        body.append(
            [f"`{one}` less `{other}`", str(len(both)), *(_correlation(each, differences) for each in sizes.values())]
        )
    return markdown(["difference of scores", "tasks", *drawn()[0].size], body)


def _correlation(one: NDArray[np.float64], other: NDArray[np.float64]) -> str:
    """Spearman's, with an interval from resamples of the tasks."""
    from scipy.stats import spearmanr

    generator = np.random.default_rng(0)
    found = [
        spearmanr(one[chosen], other[chosen]).statistic
        for chosen in generator.integers(len(one), size=(_RESAMPLES, len(one)))
        if len({*one[chosen]}) > 1
    ]
    low, high = np.quantile(found, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return f"{spearmanr(one, other).statistic:.2f} [{low:.2f}, {high:.2f}]"


def held_out() -> str:
    """One row per way to choose a method: the mean score on templates that it has not seen, and what it gives away."""
    known = [evidence.Trained(traits(task.formula), task.scores) for task in drawn()]
    chosen = dict[str, list[float]]()
    answered, best = list[float](), list[float]()
    for template in sorted({task.group[1] for task in drawn()}):
        seen = [each for each, task in zip(known, drawn(), strict=True) if task.group[1] != template]
        for task, own in zip(drawn(), known, strict=True):
            if task.group[1] != template:
                continue
            methods = [*task.scores]
            means = {method: fmean(task.scores[method]) for method in methods}
            overall = {
                method: [fmean(each.scores[method]) for each in seen if method in each.scores] for method in methods
            }
            favourite = max(methods, key=lambda method: fmean(overall[method] or [0.0]))
            rows = evidence.rated(evidence.alike(own.traits, seen, methods), methods)
            best.append(max(means.values()))
            chosen.setdefault("the best of all other templates", []).append(means[favourite])
            chosen.setdefault("`advise`, else that", []).append(means[rows[0].method] if rows else means[favourite])
            chosen.setdefault("any method", []).append(fmean(means.values()))
            answered.append(bool(rows))
    body = [[way, f"{fmean(own):.3f}", f"{fmean(best) - fmean(own):.3f}"] for way, own in chosen.items()]
    share = f"`advise` answers for {100 * fmean(answered):.0f} % of the tasks."
    return markdown(["choice", "score", "less than the best"], body) + f"\n\n{share}"


def scores() -> str:
    """What `stlbench advise` reads."""
    content = {task.name: {"formula": str(task.formula), "scores": task.scores} for task in drawn()}
    return json.dumps(content, indent=0, separators=(",", ":")) + "\n"


def main() -> None:
    """Write it, and print what follows."""
    SCORES.write_text(scores(), encoding="utf-8")
    for folder in FOLDERS:
        learned = (page_suite.methods(folder), page_suite.differences(folder), page_suite.groups(folder, "template"))
        print(folder, *learned, sep="\n\n", end="\n\n")
    print(SCORES, components(), slopes(), held_out(), sep="\n\n")


if __name__ == "__main__":
    main()
