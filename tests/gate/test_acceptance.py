"""A tenth of the robustness lost: found in the committed reference, whose equal code gives equal bits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stlbench.gate.judge import Judgement, judge
from stlbench.gate.snapshot import Sample, Snapshot, load
from stlbench.records.identity import Setting

BASE = load(Path(__file__).parents[2] / "results" / "gate-reference")
SETTINGS = sorted({cell.setting for cell in BASE.samples})

Change = Callable[[Sample, np.random.Generator], Sample]


def judged(number: int, where: Setting, change: Change) -> Judgement:
    """The new code changes the cells of one setting, and gives the bits of the reference elsewhere."""
    generator = np.random.default_rng([12, number])
    changed = {cell: change(one, generator) if cell.setting == where else one for cell, one in BASE.samples.items()}
    return judge(BASE, Snapshot(changed))


def worse(judgement: Judgement) -> set[tuple[Setting, str]]:
    return {(entry.setting, entry.metric.name) for entry in judgement.comparisons if entry.verdict == "worse"}


def tenth_lost(sample: Sample, generator: np.random.Generator) -> Sample:
    """A tenth of the robustness, give or take 3 points from seed to seed."""
    robustness = sample.numbers["robustness_mean"]
    assert robustness is not None
    loss = generator.normal(0.1, 0.03)
    return replace(sample, numbers={**sample.numbers, "robustness_mean": robustness - loss * abs(robustness)})


def test_equal_code_is_no_worse() -> None:
    assert judge(BASE, BASE).verdict == "no worse"


@pytest.mark.parametrize("count", [10, pytest.param(60, marks=pytest.mark.slow)])
def test_a_tenth_lost_in_one_setting_is_found_there_and_nowhere_else(count: int) -> None:
    places = [SETTINGS[number % len(SETTINGS)] for number in range(count)]
    found = [worse(judged(number, where, tenth_lost)) == {(where, "robustness")} for number, where in enumerate(places)]
    assert sum(found) >= count * 59 / 60
