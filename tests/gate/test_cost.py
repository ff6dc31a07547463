"""What a change costs beside its base: the verdicts, and how often they are wrong."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers.studies import load

from stlbench.gate.judge import Comparison, Verdict
from stlbench.gate.snapshot import COSTS, NUMBERS, Sample, Snapshot
from stlbench.gate.turns import MOST, Turn, judge_costs, judge_turns, unclear
from stlbench.records.identity import CellId

CPU, REWARD = COSTS
RECORDED = Path(__file__).parents[2] / "results" / "gate-pairs" / "turns.csv"
"""Ratios of turns in which both sides had the same code."""


def sample(seed: int = 0, seconds: float = 2.0, nanoseconds: float = 20.0, method: str = "funnel") -> Sample:
    numbers = dict(zip(NUMBERS, (0.3, 0.8, seconds, nanoseconds), strict=True))
    return Sample(CellId.parse(f"disc/{method}/dqn/{seed}", "smoke"), "done", "", numbers)


def having(sample: Sample, **numbers: float) -> Sample:
    return replace(sample, numbers={**sample.numbers, **numbers})


def turns(ratios: Sequence[float], rounds: int = 2, method: str = "funnel") -> list[Turn]:
    """A turn for each ratio of CPU seconds, in rounds of as many seeds."""
    seeds = math.ceil(len(ratios) / rounds)
    return [
        Turn(one.id, place // seeds + 1, one, having(one, training_cpu_seconds=2 * ratio))
        for place, ratio in enumerate(ratios)
        for one in [sample(place % seeds, method=method)]
    ]


def cpu(found: Sequence[Comparison]) -> Comparison:
    (comparison,) = (entry for entry in found if entry.metric is CPU)
    return comparison


class TestVerdict:
    @pytest.mark.parametrize(
        ("ratios", "rounds", "verdict"),
        [
            ([1.0] * 10, 1, "no worse"),
            ([0.5] * 10, 1, "no worse"),
            ([1.1] * 10, 1, "no worse"),
            ([1.3] * 10, 1, "cannot tell"),  # it takes a second round to be called worse
            ([1.3] * 20, 2, "worse"),
            ([1.0] * 9 + [5.0], 1, "no worse"),
            ([1.0] * 8 + [5.0] * 2, 1, "cannot tell"),
            ([1.0] * 5, 1, "cannot tell"),
            ([1.3] * 15 + [1.0] * 5, 2, "worse"),
            ([1.3] * 14 + [1.0] * 6, 2, "cannot tell"),
        ],
    )
    def test_it_hangs_on_the_interval_of_the_median(self, ratios: list[float], rounds: int, verdict: Verdict) -> None:
        assert cpu(judge_costs(turns(ratios, rounds))).verdict == verdict

    def test_the_numbers(self) -> None:
        found = cpu(judge_costs(turns([1.0, 1.2, 1.1, 1.4, 0.9, 1.3], rounds=1)))
        assert (found.base, found.new, found.pairs) == pytest.approx((2, 2.3, 6))
        assert [CPU.change(gain) for gain in (found.gain, found.low, found.high)] == pytest.approx(
            [math.sqrt(1.1 * 1.2), 1.4, 0.9]
        )
        assert [CPU.change(gain) for gain in found.gains] == pytest.approx([1.0, 1.2, 1.1, 1.4, 0.9, 1.3])
        # Three of six are below 1.14: as few or fewer of six fair coins are heads with 42 / 64.
        assert found.chance == pytest.approx(42 / 64)

    def test_each_setting_is_judged_alone_and_trained_again_alone(self) -> None:
        both = [*turns([1.0] * 10, 1, "raw"), *turns([1.3] * 10, 1)]
        assert {setting.method.name for setting in unclear(both)} == {"funnel"}
        assert unclear(turns([0.9, 1.4] * (MOST // 2), rounds=5)) == set()  # it has had its turns

    def test_a_cell_that_one_side_cannot_train_is_no_turn(self) -> None:
        one = sample()
        new_method = Turn(one.id, 1, None, one)
        crashed = Turn(one.id, 1, one, Sample(one.id, "raised", "no luck"))
        assert judge_costs([new_method, crashed]) == ()
        assert unclear([new_method, crashed]) == set()


class TestQualityOfTurns:
    """Compared with the reference where that has the same bits, and else with what the base gave on this machine."""

    def judged(self, reference: float, base: float | None, new: float) -> Verdict:
        three = [sample(seed) for seed in range(3)]
        before, known, now = (
            [None if value is None else having(one, robustness_mean=value) for one in three]
            for value in (base, reference, new)
        )
        given = [Turn(one.id, 1, *sides) for one, *sides in zip(three, before, now, strict=True)]
        judgement, _ = judge_turns(Snapshot({one.id: one for one in known if one}), given)
        (found,) = (entry for entry in judgement.comparisons if entry.metric.name == "robustness")
        return found.verdict

    @pytest.mark.parametrize(
        ("reference", "base", "new", "verdict"),
        [
            (0.3, 0.3, 0.27, "worse"),
            (0.27, 0.3, 0.27, "no worse"),  # a refreshed reference says that a loss is meant
            (0.3, 0.2, 0.2, "no worse"),  # this machine rounds otherwise: the base is the reference
            (0.2, 0.3, 0.27, "worse"),
            (0.3, None, 0.27, "worse"),  # the base does not know the cell
        ],
    )
    def test_a_loss(self, reference: float, base: float | None, new: float, verdict: Verdict) -> None:
        assert self.judged(reference, base, new) == verdict


# ------------------------------------------------------------------------------- on recorded turns of real trainings


def recorded(machine: str, column: str) -> list[list[float]]:
    """The ratios of each run of equal code, in the order in which they were measured."""
    runs: dict[str, list[float]] = {}
    with RECORDED.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if (row["machine"], row["code"]) == (machine, "equal"):
                runs.setdefault(row["run"], []).append(float(row[column]))
    return [runs[run] for run in sorted(runs, key=int)]


MACHINES = sorted({row["machine"] for row in csv.DictReader(RECORDED.open(encoding="utf-8"))})


def settled(ratios: Iterator[float]) -> Verdict:
    """What the gate says that takes these ratios for those of its turns, ten a round."""
    taken: list[float] = []
    while True:
        taken += [next(ratios) for _ in range(10)]
        found = turns(taken, rounds=len(taken) // 10)
        if not unclear(found):
            return cpu(judge_costs(found)).verdict


@pytest.mark.parametrize("machine", MACHINES)
@pytest.mark.parametrize("turned", [False, True], ids=["as measured", "sides exchanged"])
@pytest.mark.parametrize("step", [20, pytest.param(1, marks=pytest.mark.slow)])
def test_equal_code_is_rarely_worse_and_1_3_times_as_long_is_found(machine: str, turned: bool, step: int) -> None:
    """A run begins at any recorded turn and goes on with those that followed it, as they came."""
    every = np.array([ratio for run in recorded(machine, "CPU") for ratio in run])
    assert len(every) >= 200
    turned_to = 1 / every if turned else every
    begins = [np.roll(turned_to, -begin)[:MOST] for begin in range(0, len(every), step)]
    equal, slower = ([settled(iter(factor * ratios)) for ratios in begins] for factor in (1.0, 1.3))
    assert equal.count("worse") <= len(begins) / 200
    assert slower.count("worse") >= len(begins) * 59 / 60


def test_the_page_says_how_the_recorded_runs_ended() -> None:
    root = RECORDED.parents[2]
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in list(load("gate_pairs").table())[2:]]
    equal = {machine: int(runs) for machine, code, runs, *_ in rows if code == "equal"}
    assert [row[3:] for row in rows if row[1] == "equal"] == [
        [f"0: {runs}", f"no worse: {runs}", f"no worse: {runs}"] for runs in equal.values()
    ]
    assert [row[1:] for row in rows if row[1] != "equal"] == [
        ["slower", "3", "1: 3", "worse: 3", "no worse: 3"],
        ["worse", "3", "1: 3", "no worse: 3", "worse: 3"],
    ]
    page = " ".join((root / "docs" / "howto" / "share.md").read_text(encoding="utf-8").split())
    said = f"no false alarm in {sum(equal.values())} runs of equal code, {equal['loaded']} of them under load"
    assert f"{said}; this bounds the rate only at 7 %. It found all three runs with 30 % more CPU, and all" in page
