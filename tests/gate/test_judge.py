"""What is worse, what is not, and what cannot be told: on made-up snapshots, with values computed by hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from stlbench.gate.judge import EXIT, Comparison, Judgement, judge
from stlbench.gate.snapshot import METRICS, Sample, Snapshot, absolute, relative, speed
from stlbench.records.identity import CellId
from stlbench.records.result import Status
from stlbench.registry.choices import Choice

ROBUSTNESS, SATISFACTION, CPU, REWARD = METRICS
TASKS = ("disc", "disc-coarse", "line", "nav")
METHODS = ("flag", "funnel", "raw", "tau-mdp")


def cell(seed: int = 0, status: Status = "done", **numbers: Any) -> Sample:
    measured = {"robustness_mean": 0.3, "satisfaction": 0.8, "training_cpu_seconds": 2.0, "reward_nanoseconds": 20.0}
    known = (measured if status == "done" else {}) | numbers
    return Sample(CellId.parse(f"disc/funnel/dqn/{seed}", "smoke"), status, known.pop("reason", ""), known)


def of_method(sample: Sample, method: str) -> Sample:
    return replace(sample, id=replace(sample.id, method=Choice(method)))


def snapshot(*samples: Sample) -> Snapshot:
    return Snapshot({sample.id: sample for sample in samples})


def compared(base: Sequence[Sample], new: Sequence[Sample]) -> Judgement:
    return judge(snapshot(*base), snapshot(*new))


def satisfactions(base: Sequence[float], new: Sequence[float]) -> Comparison:
    """The comparison of satisfaction alone, one value per seed."""
    one, two = ([cell(seed, satisfaction=value) for seed, value in enumerate(values)] for values in (base, new))
    return found(compared(one, two), "satisfaction")


def found(judgement: Judgement, metric: str) -> Comparison:
    (comparison,) = (entry for entry in judgement.comparisons if entry.metric.name == metric)
    return comparison


# ------------------------------------------------------------------------------------------------------ by hand


def test_gains() -> None:
    base, new = np.array([1.0, -0.1]), np.array([0.9, -0.11])
    # The mean size is 0.55, so the second seed counts as 0.275.
    assert relative(base, new) == pytest.approx([-0.1, -0.01 / 0.275])
    assert relative(np.zeros(2), new) == pytest.approx(new)
    assert absolute(base, new) == pytest.approx([-0.1, -0.01])
    assert speed(np.array([1.0, 3.0]), np.array([2.0, 1.5])) == pytest.approx([-math.log(2), math.log(2)])


def test_the_t_test() -> None:
    comparison = satisfactions([0.5, 0.5, 0.5], [0.3, 0.2, 0.4])
    assert (comparison.base, comparison.new, comparison.pairs) == pytest.approx((0.5, 0.3, 3))
    # The mean of -0.2, -0.3, -0.1 is -0.2 with standard error 0.1 / sqrt(3), so t = -2 sqrt(3). With two degrees of
    # freedom P(T < t) = 1/2 + t / (2 sqrt(2 + t^2)), and P(T < 2.91999) = 0.95.
    assert comparison.gain == pytest.approx(-0.2)
    assert comparison.chance == pytest.approx(0.5 - math.sqrt(12) / (2 * math.sqrt(14)))
    assert comparison.low == pytest.approx(-0.2 - 2.91999 * 0.1 / math.sqrt(3), abs=1e-5)
    assert comparison.high == pytest.approx(-0.2 + 2.91999 * 0.1 / math.sqrt(3), abs=1e-5)
    assert comparison.verdict == "cannot tell"


def test_costs_are_told_and_never_judged() -> None:
    base = [cell(seed) for seed in range(5)]
    judgement = compared(base, [cell(seed, training_cpu_seconds=8.0, reward_nanoseconds=60.0) for seed in range(5)])
    assert (judgement.verdict, EXIT[judgement.verdict]) == ("no worse", 0)
    told = [(entry.metric, entry.metric.change(entry.gain), entry.verdict) for entry in judgement.comparisons[2:]]
    assert told == [(CPU, pytest.approx(4), "not judged"), (REWARD, pytest.approx(3), "not judged")]


# ---------------------------------------------------------------------------------------------------- the verdicts


@pytest.mark.parametrize(
    ("base", "new", "verdict"),
    [
        ([0.5], [0.5], "no worse"),  # the same needs no second seed
        ([0.5], [0.4], "cannot tell"),
        ([0.5, 0.5], [0.1, 0.1], "cannot tell"),
        ([0.5, 0.5, 0.5], [0.1, 0.1, 0.1], "worse"),
        ([0.5, 0.5, 0.5], [0.46, 0.46, 0.46], "no worse"),  # 4 points are tolerated
        ([0.5, 0.5, 0.5], [0.44, 0.44, 0.44], "worse"),
        ([0.5, 0.5, 0.5], [0.9, 0.8, 0.9], "no worse"),
        ([0.5, 0.5, 0.5], [0.9, 0.1, 0.5], "cannot tell"),  # no loss on average, and a large one not excluded
        ([0.5, 0.5, 0.5], [0.5, 0.5, 0.0], "cannot tell"),
    ],
)
def test_a_verdict(base: list[float], new: list[float], verdict: str) -> None:
    assert satisfactions(base, new).verdict == verdict


def test_a_number_that_is_none_any_more_is_worse() -> None:
    base = [cell(seed) for seed in range(3)]
    for bad in (math.nan, -math.inf):
        judgement = compared(base, [*base[:2], cell(2, robustness_mean=bad)])
        assert found(judgement, "robustness").verdict == "worse"
    # and where the base has none, the other seeds decide
    assert found(compared([*base, cell(3, robustness_mean=math.inf)], [*base, cell(3)]), "robustness").pairs == 3


@pytest.mark.parametrize(
    ("base", "new", "verdict"),
    [
        ("done", "raised", "worse"),
        ("done", "killed", "worse"),
        ("done", "unsuitable", "worse"),
        ("done", None, "missing"),
        ("raised", "raised", "missing"),
        ("raised", "timeout", "worse"),
        ("intractable", "raised", "worse"),
        ("intractable", None, "missing"),
        ("raised", "done", None),
        ("intractable", "intractable", None),
        ("intractable", "unsuitable", None),
        ("unsuitable", "done", None),
    ],
)
def test_how_cells_ended(base: Status, new: Status | None, verdict: str | None) -> None:
    fine = [cell(seed) for seed in range(3)]
    twin = [] if new is None else [cell(3, new, reason="too bad")]
    judgement = compared([*fine, cell(3, base, reason="")], [*fine, *twin])
    assert judgement.verdict == (verdict or "no worse")
    assert [entry.verdict for entry in judgement.findings] == ([verdict] if verdict else [])
    for finding in judgement.findings:
        assert finding.cell.name == "disc/funnel/dqn/3"
        assert ("too bad" in finding.reason) == (new is not None)


def test_the_worst_counts_and_nothing_is_not_fine() -> None:
    fine, other = [cell(seed) for seed in range(3)], [of_method(cell(seed), "raw") for seed in range(3)]
    unclear = [cell(seed, satisfaction=value) for seed, value in enumerate((0.9, 0.1, 0.8))]
    assert compared(fine, fine).verdict == compared(fine, [*fine, cell(7, "raised")]).verdict == "no worse"
    assert compared(fine, unclear).verdict == "cannot tell"
    assert compared(fine + other, unclear).verdict == "missing"
    assert compared(fine + other, [*unclear, replace(other[0], status="raised")]).verdict == "worse"
    assert compared([], fine).verdict == "missing"
    assert compared([cell(0, "intractable")], [cell(0, "intractable")]).verdict == "missing"
    assert EXIT == {"no worse": 0, "not judged": 0, "worse": 1, "cannot tell": 3, "missing": 4}


# ------------------------------------------------------------------------- 80 cells as they come out of real runs


@cache
def reference(seeds: int = 5) -> list[Sample]:
    """Four tasks, four methods; robustness differs between seeds by two fifths, as after a short training."""
    rng = np.random.default_rng(1)
    samples = []
    for task in TASKS:
        for method in METHODS:
            scale, cpu, reward = rng.choice([-1, 1]) * 10 ** rng.uniform(-1, 1), *10 ** rng.uniform([-1, 1], [1, 2.5])
            for seed in range(seeds):
                values = {
                    "robustness_mean": float(scale * rng.normal(1, 0.4)),
                    "satisfaction": float(np.clip(rng.normal(0.6, 0.2), 0, 1)),
                    "training_cpu_seconds": float(cpu),
                    "reward_nanoseconds": float(reward),
                }
                samples.append(replace(cell(seed, **values), id=CellId.parse(f"{task}/{method}/dqn/{seed}", "smoke")))
    return samples


def elsewhere(sample: Sample, rng: np.random.Generator) -> Sample:
    """The same cell on another machine: rounding differs, so a seed is another draw, as if its number were another."""
    robustness, satisfaction = ROBUSTNESS.value(sample), SATISFACTION.value(sample)
    assert robustness is not None
    assert satisfaction is not None
    drawn = {
        "robustness_mean": robustness * float(rng.normal(1, 0.4)),
        "satisfaction": float(np.clip(satisfaction + rng.normal(0, 0.2), 0, 1)),
    }
    return replace(sample, numbers={**sample.numbers, **drawn})


def rerun(change: Callable[[Sample, np.random.Generator], Sample], number: int, seeds: int = 5) -> Judgement:
    rng, base = np.random.default_rng([2, number]), reference(seeds)
    return compared(base, [change(sample, rng) for sample in base])


def test_equal_code_on_another_machine_is_called_worse_at_most_once_in_50_runs() -> None:
    verdicts = [rerun(elsewhere, number).verdict for number in range(50)]
    assert verdicts.count("worse") <= 1
    assert "no worse" not in verdicts  # five seeds that scatter so much say nothing, and are not said to
