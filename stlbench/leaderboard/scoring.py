"""A bundle as the leaderboard sees it: checked, held against the rules, its policies scored on fresh starts."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stlbench.errors import UsageError
from stlbench.leaderboard.entry import Entry, Numbers, Refused, Scored
from stlbench.leaderboard.rules import broken
from stlbench.records.result import Result, reported
from stlbench.rollout.questions import Unanswered, plugins_of
from stlbench.search.space import space_of
from stlbench.search.subject import of_policy
from stlbench.share.checked import check, results_in, unpacked
from stlbench.share.crate import METADATA, about
from stlbench.share.rescored import Rescored, score_cell
from stlbench.study.cell import derive_seed
from stlbench.study.plugin_guard import LONG, ask
from stlbench.study.policies import load_policy

LARGEST = 2**28
"""Bytes that a submitted bundle may have unpacked."""
STARTS = 1000
"""Fresh starts, where the budget of the task does not say how many random ones it reports."""
_NAME = re.compile(r"[a-z0-9][a-z0-9-]{0,60}\.zip")

Told = Callable[[str, str], None]
"""Is told a cell's name and what was found of it, as it comes."""


def score(path: Path, draw: int, told: Told) -> Entry | Refused:
    """Check a bundle, and score its policies. Nothing of it is run: policies are arrays.

    Args:
        path: of the bundle.
        draw: seed of the fresh starts.
        told: is called after each cell.
    """
    if not _NAME.fullmatch(path.name):
        return Refused(path.name, ("its name should consist of a-z, 0-9 and -, and end in .zip",))
    if path.is_symlink():
        return Refused(path.name, ("it is a link to a file, and no file",))
    try:
        problems = check(path, LARGEST).problems
    except UsageError as error:
        problems = (str(error),)
    if problems:
        return Refused(path.name, problems)
    with unpacked(path, LARGEST) as (folder, _):
        facts, results = about((folder / METADATA).read_text(encoding="utf-8")), tuple(results_in(folder))
        problems = tuple(broken(facts, results))
        if problems:
            return Refused(path.name, problems)
        cells = list[Scored]()
        for result in results:
            cells.append(_scored(result, folder, draw, score_cell(result, folder)))
            told(result.id.name, cells[-1].record or cells[-1].status)
    return Entry(
        bundle=path.name,
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        title=facts.title,
        authors=facts.authors,
        license=facts.license,
        date=facts.date,
        cells=tuple(cells),
    )


def _scored(result: Result, folder: Path, draw: int, again: Rescored | None) -> Scored:
    if result.measurement is None or again is None:
        return Scored(result.id, result.status, result.reason)
    said = reported(result.measurement.selected)
    claimed = Numbers(said.mean, said.satisfaction, said.starts)
    if again.found is None:
        return Scored(result.id, result.status, claimed=claimed, record=again.verdict, why=again.why)
    (found,) = ask([_FreshStarts(result, folder, draw)], LONG)
    if isinstance(found, Unanswered):
        return Scored(result.id, result.status, claimed=claimed, record=again.verdict, why=found.reason)
    return Scored(result.id, result.status, claimed=claimed, found=found, record=again.verdict)


@dataclass(frozen=True)
class _FreshStarts:
    """What does a policy get from fresh starts?"""

    result: Result
    folder: Path
    draw: int

    @property
    def plugins(self) -> tuple[tuple[str, str], ...]:
        """See `Question`."""
        return plugins_of(self.result.id)

    @property
    def failed(self) -> str:
        """See `Question`."""
        return f"{self.result.id.name} cannot be scored"

    def answer(self) -> Numbers:
        """See `Question`."""
        cell, kept = self.result.id, load_policy(self.folder, self.result)
        task, subject = kept.task, of_policy(cell.name, (), kept.task, kept.method, kept.policy)
        budget, space = task.file.budgets.get(cell.budget), space_of(task)
        count = (budget.random_starts if budget else 0) or STARTS
        generator = np.random.default_rng(derive_seed("leaderboard", task.choice.name, self.draw))
        points = space.draw(generator, count)
        played = [subject.play(points[i : i + subject.rows]) for i in range(0, count, subject.rows)]
        robustness = np.concatenate([each.robustness for each in played])
        satisfied = np.concatenate([each.satisfied for each in played])
        return Numbers(float(robustness.mean()), float(satisfied.mean()), count)
