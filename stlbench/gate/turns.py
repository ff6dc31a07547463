"""Costs by turns: base and new train the same cell one right after the other, until each cost is clear.

Each turn gives one ratio. The median ratio of a setting is compared with the tolerated one by its exact 95 % interval,
which assumes no distribution (the interval of the sign test: Conover 1999, Practical Nonparametric Statistics, 3.2).
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from tempfile import TemporaryFile
from typing import Any, NamedTuple, Self

import numpy as np
from scipy import special

from stlbench.errors import UsageError, one_line
from stlbench.gate.judge import COSTS, QUALITIES, Comparison, Judgement, Metric, Verdict, compare, judge, values_of
from stlbench.gate.snapshot import Sample, Snapshot
from stlbench.gate.trees import Tree
from stlbench.records.identity import CellId, Setting
from stlbench.statistics.intervals import median_interval

MOST = 50  # turns of a setting after which its verdict stays open
ROUNDS = 2  # the fewest rounds after which anything is worse: slower code stays slow, and disturbances go
FEWEST = 6  # turns from which on the median has an interval of 95 %


class Turn(NamedTuple):
    """One cell, trained by both sides; None if a revision does not know the cell."""

    cell: CellId
    round: int
    """Rounds count from 1. Each round has each cell of a setting once."""
    base: Sample | None
    new: Sample | None


def judge_turns(reference: Snapshot, turns: Sequence[Turn]) -> tuple[Judgement, Snapshot]:
    """The verdict on a change, and the snapshot of its cells.

    Costs are compared turn by turn. Robustness and satisfaction are compared with the reference if the two are equal,
    else with the base's values on this machine: the reference's machine may round differently.
    """
    first = [turn for turn in turns if turn.round == 1]
    new = Snapshot({turn.cell: turn.new for turn in first if turn.new is not None})
    given = {turn.cell: turn.base for turn in first if turn.base is not None}
    expected = {
        cell: sample if _same(sample, new.samples.get(cell)) else given.get(cell, sample)
        for cell, sample in reference.samples.items()
    }
    judgement = judge(Snapshot(expected), new)
    qualities = (comparison for comparison in judgement.comparisons if not comparison.metric.is_cost)
    return Judgement((*qualities, *judge_costs(turns)), judgement.findings), new


def _same(one: Sample, two: Sample | None) -> bool:
    return two is not None and all(metric.value(one) == metric.value(two) for metric in QUALITIES)


def judge_costs(turns: Iterable[Turn]) -> tuple[Comparison, ...]:
    """Both costs of each setting of which both sides finished a cell.

    A setting is *worse* if its whole interval is above the tolerated ratio after two rounds or more, and *no worse* if
    its whole interval is at most that ratio; otherwise the turns *cannot tell*.
    """
    settings = defaultdict[Setting, list[Turn]](list)
    for turn in turns:
        settings[turn.cell.setting].append(turn)
    compared = (_by_turns(setting, metric, own) for metric in COSTS for setting, own in sorted(settings.items()))
    return tuple(comparison for comparison in compared if comparison is not None)


def unclear(turns: Sequence[Turn]) -> set[Setting]:
    """The settings that need more turns: the verdict on one of their costs is still open."""
    taken = Counter(turn.cell.setting for turn in turns)
    open_ones = {each.setting for each in judge_costs(turns) if each.verdict == "cannot tell"}
    return {setting for setting in open_ones if taken[setting] < MOST}


def _by_turns(setting: Setting, metric: Metric, turns: Sequence[Turn]) -> Comparison | None:
    pairs = [(turn.base, turn.new) for turn in turns]
    compared = compare(setting, metric, pairs)
    if compared is None:
        return None
    gains = metric.gain(*values_of(metric, pairs).T)
    low, high = (len(gains) >= FEWEST and median_interval(gains.tolist())) or (-math.inf, math.inf)
    verdict: Verdict = "cannot tell"
    if low >= -metric.tolerated:
        verdict = "no worse"
    elif high < -metric.tolerated and max(turn.round for turn in turns) >= ROUNDS:
        verdict = "worse"
    chance = float(special.bdtr(int(np.sum(gains >= -metric.tolerated)), len(gains), 0.5))
    return replace(compared, low=low, high=high, chance=chance, verdict=verdict, gains=tuple(gains.tolist()))


def take_turns(cells: Collection[CellId], base: Tree, new: Tree, say: Callable[[str], None]) -> list[Turn]:
    """Train each cell with both trees, and repeat the settings whose costs are not clear yet.

    One training runs at a time. Settings take turns too, so that other load on the machine affects all of them.
    Raises `UsageError` if a tree cannot train, or the base runs code of the change.
    """
    turns: list[Turn] = []
    waiting, number = sorted(cells, key=lambda cell: (cell.seed, cell)), 0
    while waiting:
        number += 1
        count = f"{len(waiting)} {'cell' if len(waiting) == 1 else 'cells'}"
        say(f"round {number}: {count}, each by {base.name} and by {new.name}")
        with Trainer(base, new) as one, Trainer(new, base) as other:  # a process that happens to be slow does not stay
            turns += [_turn(cell, number, one, other) for cell in waiting]
        settings = unclear(turns)
        waiting = [cell for cell in waiting if cell.setting in settings]
    return turns


def _turn(cell: CellId, number: int, base: Trainer, new: Trainer) -> Turn:
    if (cell.seed + number) % 2:
        before, after = base.train(cell), new.train(cell)
    else:
        after, before = new.train(cell), base.train(cell)
    return Turn(cell, number, before, after)


class Trainer:
    """A process that trains with the code of `tree` (`stlbench.gate.trainer`), and with no code of `other`."""

    def __init__(self, tree: Tree, other: Tree) -> None:
        self.tree, self.other = tree, other
        self.errors = TemporaryFile()  # noqa: SIM115 - closed at the end of this context
        self.process = subprocess.Popen(
            [sys.executable, "-P", "-m", "stlbench.gate.trainer"],
            cwd=tree.root,
            env=dict(tree.environment),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            text=True,
            start_new_session=True,
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)  # also the process of a cell that still trains
        self.process.communicate()
        self.errors.close()

    def train(self, cell: CellId) -> Sample | None:
        """The cell's numbers; None if this tree does not know the cell.

        Raises:
            UsageError: the process ended, or loaded a module of the other tree.
        """
        answer = self._answer(json.dumps(cell.plain))
        status, reason = answer.pop("status"), one_line(answer.pop("reason"))
        foreign = [file for file in answer.pop("files", ()) if self.other.holds(file)]
        if foreign:
            raise UsageError(f"{self.tree.name} cannot be measured: its training loads {foreign[0]}")
        return None if status == "unknown" else Sample(cell, status, reason, **answer)

    def _answer(self, request: str) -> dict[str, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            self.process.stdin.write(request + "\n")
            self.process.stdin.flush()
            line = self.process.stdout.readline()
        except BrokenPipeError:
            line = ""
        if not line:
            self.process.wait()
            self.errors.seek(0)
            lines = self.errors.read().decode(errors="replace").strip().splitlines()
            raise UsageError(f"{self.tree.name} cannot train: {one_line((lines or ['no reason given'])[-1])}")
        answer: dict[str, Any] = json.loads(line)
        return answer
