"""Answers from trainings on the suite: what explains scores, what they depend on, whether a form tells the best method.

python studies/suite_answers.py     write the scores that `stlbench advise` reads; studies/pages.py writes the tables
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from statistics import fmean

import numpy as np
import recorded
from numpy.typing import NDArray
from recorded import markdown

from stlbench import stl
from stlbench.report import evidence
from stlbench.statistics import across
from stlbench.statistics.intervals import LEVEL
from stlbench.task.forms import traits
from stlbench_tasks import suite
from stlbench_tasks.suite.formulas import FormulaSuite

FOLDERS = ("suite-core", "suite-quick")
"""Folders of results; a cell that both have counts once."""
SCORES = Path(suite.__file__).with_name("scores.json")
_RESAMPLES = 999
SHOWN = ("funnel", "funnel[variant=code]", "raw", "flag", "bhnr", "dense", "cfer")
"""The methods of core."""


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


@cache
def drawn(folders: Sequence[str] = FOLDERS) -> tuple[Drawn, ...]:
    """All tasks that a committed study has trained on."""
    tasks, known = dict[str, dict[str, dict[str, float]]](), FormulaSuite()
    names = {f"suite-{name.replace('/', '-')}": name for name in known.names}
    for row in (row for folder in folders for row in recorded.table(folder, "cells")):
        if row["status"] == "done" and (row["budget"], row["track"]) == ("quick", "auto"):
            score = recorded.scored(row["task"], float(row["robustness_mean"]))
            tasks.setdefault(names[row["task"]], {}).setdefault(row["method"], {})[row["seed"]] = round(score, 4)
    formulas = {name: stl.parse(known.candidate(name).content("")["formula"]) for name in tasks}
    return tuple(
        Drawn(name, formulas[name], {method: tuple(own.values()) for method, own in sorted(methods.items())})
        for name, methods in sorted(tasks.items())
    )


def components() -> str:
    """One row per source of differences: its share of the variance of a run's score, on tasks that all `SHOWN` fit.

    Sums of squares are taken in this order, so what two sources share counts for the first. The part that seeds add to
    each by chance is taken off. Intervals are from resamples of the tasks.
    """
    tasks = [task for task in drawn() if {*SHOWN} <= {*task.scores}]
    generator = np.random.default_rng(0)
    resamples = [
        _shares([tasks[i] for i in generator.integers(len(tasks), size=len(tasks))]) for _ in range(_RESAMPLES)
    ]
    found = _shares(tasks)
    ends = np.quantile([list(each.values()) for each in resamples], [(1 - LEVEL) / 2, (1 + LEVEL) / 2], axis=0)
    body = [
        [source, f"{100 * share:.0f} % [{100 * low:.0f}, {100 * high:.0f}]"]
        for (source, share), low, high in zip(found.items(), *ends, strict=True)
    ]
    return markdown([f"source, {len(tasks)} tasks", "share of the variance"], body, right=1)


def _same_seeds(tasks: Sequence[Drawn]) -> int:
    """How many seeds every method of core has on all these tasks: some tasks of `quick` have more."""
    return min(len(task.scores[method]) for task in tasks for method in SHOWN if method in task.scores)


def _shares(tasks: Sequence[Drawn]) -> dict[str, float]:
    """Every method has as many seeds on every task, so differences between tasks and those within are apart.

    A mean over seeds has the seeds' variance over their number. A source adds as much by chance for each of its degrees
    of freedom. A rest below 0 counts as 0.
    """
    seeds = _same_seeds(tasks)
    scores = np.array([[task.scores[method][:seeds] for method in SHOWN] for task in tasks])
    means = scores.mean(axis=2)
    of_tasks, within = means.mean(axis=1, keepdims=True), means - means.mean(axis=1, keepdims=True)
    templates = _columns(template for _, template in (task.group for task in tasks))
    systems = np.hstack([templates, _columns(system for system, _ in (task.group for task in tasks))])
    nothing, constant = np.zeros((len(tasks), 1)), np.ones((len(tasks), 1))
    names = ("template", "system", "task", "method", "method and template", "method and system", "method and task")
    left = [len(SHOWN) * _unexplained(of_tasks, columns) for columns in (constant, templates, systems)]
    left += [0.0, *(_unexplained(within, columns) for columns in (nothing, constant, templates, systems)), 0.0]
    sums = np.delete(-np.diff(left), 3)
    ranks = [int(np.linalg.matrix_rank(columns)) for columns in (constant, templates, systems)]
    between = np.diff([*ranks, len(tasks)])
    freedom = [*between, *((len(SHOWN) - 1) * np.array([1, *between]))]
    of_seed = float(((scores - means[..., None]) ** 2).sum()) / max(1, seeds - 1) / means.size
    parts = np.maximum(sums - np.array(freedom) * of_seed / seeds, 0.0)
    found = dict(zip(names, parts.tolist(), strict=True)) | {"seed": of_seed * means.size}
    whole = sum(found.values())
    return {source: share / whole for source, share in found.items()}


def _columns(labels: Iterable[str]) -> NDArray[np.float64]:
    """(labels, kinds): 1 where a label is of a kind."""
    own = [*labels]
    kinds = {label: number for number, label in enumerate(dict.fromkeys(own))}
    return np.eye(len(kinds))[[kinds[label] for label in own]]


def _unexplained(values: NDArray[np.float64], columns: NDArray[np.float64]) -> float:
    """The sum of squares of what is left of the values (tasks, any) by the columns (tasks, any)."""
    return float(((values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0]) ** 2).sum())


def held_out() -> str:
    """One row per way to choose a method: the mean score on templates and seeds that it has not seen.

    A way chooses by one seed of the other templates, and is judged by the other seed of this one; both take turns. The
    best of a task is chosen by one of its own seeds, since the greatest of noisy scores is above that of the best.
    """
    turns = [_chosen(seen, judged) for seen, judged in ((0, 1), (1, 0))]
    ways = {way: [fmean(both) for both in zip(*(turn[way] for turn in turns), strict=True)] for way in turns[0]}
    own, best = ways[_ADVISE], ways[_BEST]
    body = [
        [way, f"{fmean(found):.3f}", *("" if found is other else _less(other, found) for other in (best, own))]
        for way, found in ways.items()
    ]
    answered = [bool(rows) for _, rows in _advised(0)]
    share = f"`advise` answers for {100 * fmean(answered):.0f} % of the tasks."
    return markdown(["choice", "score", "the best has more", "`advise` has more"], body, right=3) + f"\n\n{share}"


_ADVISE, _BEST = "`advise`, else the first row", "the best of the task"


def _advised(seen: int) -> Iterator[tuple[list[evidence.Trained], list[evidence.Rated]]]:
    """For each task what one seed says of the other templates, and how `advise` rates methods by that."""
    known = [
        evidence.Trained(traits(task.formula), {method: own[seen : seen + 1] for method, own in task.scores.items()})
        for task in drawn()
    ]
    for task, own in zip(drawn(), known, strict=True):
        others = [each for each, other in zip(known, drawn(), strict=True) if other.group[1] != task.group[1]]
        yield others, evidence.rated(evidence.alike(own.traits, others, [*task.scores]), [*task.scores])


def _chosen(seen: int, judged: int) -> dict[str, list[float]]:
    """Way to choose -> for each task the score, in the seed that judges, of what it chose by the other."""
    ways = dict[str, list[float]]()
    every = set.intersection(*({*task.scores} for task in drawn()))
    for task, (others, rows) in zip(drawn(), _advised(seen), strict=True):
        overall = {method: fmean(each.scores[method][0] for each in others) for method in every}
        steady = max(sorted(every), key=overall.__getitem__)
        picked = {
            "always the best of all forms": steady,
            _ADVISE: rows[0].method if rows else steady,
            _BEST: max(task.scores, key=lambda method: task.scores[method][seen]),
        }
        for way, method in picked.items():
            ways.setdefault(way, []).append(task.scores[method][judged])
        ways.setdefault("any method", []).append(fmean(own[judged] for own in task.scores.values()))
    return ways


def _less(more: Sequence[float], own: Sequence[float]) -> str:
    """The mean difference, with its interval over the tasks."""
    value, ends = across.sample_mean([np.array([most - each]) for most, each in zip(more, own, strict=True)])
    assert ends is not None
    shown, low, high = (recorded.number(str(each)) for each in (value, *ends))
    return f"{shown} [{low}, {high}]"


def scores() -> str:
    """The file that `stlbench advise` reads. A task that has a schedule has only the scores of methods with it."""
    before = {task.name: task for task in drawn()}
    now = {task.name: task for task in drawn(("suite-schedules",))}
    same = {name for name, task in now.items() if task.scores["raw"] == before[name].scores.get("raw", ())[:2]}
    latest = before | {name: task for name, task in now.items() if name not in same}
    content = {name: {"formula": str(task.formula), "scores": task.scores} for name, task in sorted(latest.items())}
    return json.dumps(content, indent=0, separators=(",", ":")) + "\n"


def main() -> None:
    """Write it."""
    SCORES.write_text(scores(), encoding="utf-8")
    print(SCORES)


if __name__ == "__main__":
    main()
