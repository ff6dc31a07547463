"""What the gate is for, on simulated runs with the noise of the committed measurements, load included, and retakes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from helpers.gate_noise import LOADED, REFERENCE, TIMES, Run, measured_times, scatter, shifts

from stlbench.gate.files import load
from stlbench.gate.judge import Judgement, judge
from stlbench.gate.metrics import LOAD
from stlbench.gate.retakes import settle
from stlbench.gate.snapshot import Sample, Snapshot, pair
from stlbench.identity import Setting

PAGE = Path(__file__).parents[2] / "docs" / "ci.md"
CELLS = [sample for sample in load(REFERENCE).samples.values() if sample.status == "done"]
SETTINGS = sorted({cell.id.setting for cell in CELLS})

Change = Callable[[Sample, np.random.Generator], Sample]


def unchanged(sample: Sample, _: np.random.Generator) -> Sample:
    return sample


def judged(number: int, change: Change = unchanged, where: Setting | None = None) -> Judgement:
    """One run of the gate; `change` is what the new code does to a cell, in every take."""
    generator = np.random.default_rng([12, number])
    run = Run(measured_times(), CELLS, generator)

    def changed(snapshot: Snapshot) -> Snapshot:
        samples = snapshot.samples.values()
        new = [change(one, generator) if where in (None, one.id.setting) else one for one in samples]
        return Snapshot({one.id: one for one in new})

    new = settle(run.base, changed(run.take()), lambda cells, number: changed(run.take(cells, number)))
    return judge(pair(run.base, new))


def caught(metric: str, change: Change, number: int) -> bool:
    """Whether a change of one setting alone, each in its turn, is called worse there, and nothing else is."""
    where = SETTINGS[number % len(SETTINGS)]
    worse = [entry for entry in judged(number, change, where).comparisons if entry.verdict == "worse"]
    return {(entry.setting, entry.metric.name) for entry in worse} == {(where, metric)}


def tenth_lost(sample: Sample, generator: np.random.Generator) -> Sample:
    """A tenth of the robustness, give or take 3 points from seed to seed."""
    assert sample.robustness_mean is not None
    loss = generator.normal(0.1, 0.03)
    return replace(sample, robustness_mean=sample.robustness_mean - loss * abs(sample.robustness_mean))


def twice_the_cost(sample: Sample, _: np.random.Generator) -> Sample:
    assert sample.reward_nanoseconds
    return replace(sample, reward_nanoseconds=2 * sample.reward_nanoseconds)


class TestEqualCode:
    def test_at_most_one_false_alarm_in_200_runs(self) -> None:
        verdicts = [judged(number).verdict for number in range(200)]
        assert sum(verdict != "no worse" for verdict in verdicts) <= 1

    def test_what_load_does_is_less_than_the_test_allows_for(self) -> None:
        base, new = load(REFERENCE), load(LOADED)
        for metric in TIMES:
            away = shifts(base, new, metric)
            assert abs(away.mean()) < np.log(LOAD)
            assert np.abs(away).max() < metric.tolerated

    def test_it_had_the_same_robustness_beside_the_load(self) -> None:
        base, new = load(REFERENCE).samples, load(LOADED).samples
        assert base.keys() == new.keys()
        assert [one.robustness_mean for one in base.values()] == [new[cell].robustness_mean for cell in base]


class TestBrokenCode:
    """Each of 60 runs breaks one setting, one after the other; what is found is that one and no other."""

    RUNS = range(60)

    def test_a_tenth_of_the_robustness_lost_is_caught(self) -> None:
        assert sum(caught("robustness", tenth_lost, number) for number in self.RUNS) >= 59

    def test_a_reward_that_costs_twice_as_much_is_caught(self) -> None:
        assert sum(caught("reward", twice_the_cost, number) for number in self.RUNS) >= 59


def test_a_loss_that_comes_with_other_trainings_is_caught_where_seeds_scatter_little() -> None:
    """A change that loses a tenth on average and makes each training another: every seed is another draw."""
    found = dict[str, tuple[int, float]]()
    for setting in SETTINGS:
        robustness = np.array([cell.robustness_mean for cell in CELLS if cell.id.setting == setting])
        mean, away = robustness.mean(), robustness.std(ddof=1)

        def redrawn(sample: Sample, generator: np.random.Generator, mean: float = mean, away: float = away) -> Sample:
            return replace(sample, robustness_mean=float(generator.normal(mean - 0.1 * abs(mean), away)))

        worse = [
            any(one.verdict == "worse" for one in judged(number, redrawn, setting).comparisons) for number in range(10)
        ]
        found[setting.name] = sum(worse), float(away / abs(mean))
    for name, (count, scattered) in found.items():
        assert count == 10 or scattered > 0.03, name
        assert count < 5 or scattered < 0.15, name


def test_the_page_says_how_much_the_committed_reference_scatters() -> None:
    text, base = " ".join(PAGE.read_text(encoding="utf-8").split()), load(REFERENCE)
    training, reward = (f"{scatter(base, metric):.2f}" for metric in TIMES)
    assert f"the logarithms of calibrated times scatter by {training} (training) and {reward} (reward)" in text
