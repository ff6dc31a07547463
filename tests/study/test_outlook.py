"""How long a study still takes, on runs whose end is known."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.simulated_runs import simulate

from stlbench.records.identity import CellId
from stlbench.study.outlook import Begun, Took, time_left

SECONDS = {"hold-disc": 12.0, "overlap": 25.0, "pendulum": 18.0, "robot-nav": 60.0}
STEPS = {"hold-disc": 16_000, "overlap": 40_000, "pendulum": 25_000, "robot-nav": 100_000}
FACTORS = {"flag": 1.0, "funnel": 1.1, "tau-mdp": 1.6}


def cell(task: str, method: str, seed: int) -> CellId:
    return CellId.parse(f"{task}/{method}/dqn/{seed}", "quick")


def study(generator: np.random.Generator, seeds: int) -> list[tuple[CellId, float]]:
    """Seeds outermost, as plans have them; cells that differ in the seed alone differ by 15 %."""
    return [
        (cell(task, method, seed), SECONDS[task] * FACTORS[method] * generator.uniform(0.85, 1.15))
        for seed in range(seeds)
        for task in SECONDS
        for method in FACTORS
    ]


@pytest.mark.parametrize("jobs", [1, 2, 4, 7])
@pytest.mark.parametrize("seeds", [2, 5, 10])
def test_after_a_quarter_of_the_run_it_is_right_within_a_fifth(jobs: int, seeds: int) -> None:
    for number in range(20):
        seen = simulate(study(np.random.default_rng(number), seeds), jobs, 0.25)
        found = time_left(seen.waiting, seen.begun, seen.took, jobs, lambda each: STEPS[each.task.name])
        assert found == pytest.approx(seen.left, rel=0.2)


@pytest.mark.parametrize("jobs", [1, 2, 4])
def test_of_a_single_seed_it_is_right_within_a_half(jobs: int) -> None:
    """After a quarter only one or two of the tasks were seen."""
    for number in range(20):
        seen = simulate(study(np.random.default_rng(number), 1), jobs, 0.25)
        found = time_left(seen.waiting, seen.begun, seen.took, jobs, lambda each: STEPS[each.task.name])
        assert found == pytest.approx(seen.left, rel=0.5)


def test_cells_of_one_setting_that_all_run_at_once_tell_by_their_checkpoints() -> None:
    cells = [(cell("hold-disc", "flag", seed), 40.0) for seed in range(4)]
    seen = simulate(cells, 4, 0.25)
    assert time_left(seen.waiting, seen.begun, seen.took, 4) == pytest.approx(30.0, rel=0.2)


def test_nothing_is_known_before_a_checkpoint() -> None:
    assert time_left([cell("overlap", "flag", 0)], [Begun(cell("overlap", "flag", 1), 5.0, 0.0, 0.0)], [], 1) is None


def test_the_last_cell_counts_not_the_mean() -> None:
    """By hand: two at a time; the rest of one that runs is 5, three wait for 10 each: 10 + 10 on one, 5 + 10 beside."""
    took = [Took(cell("overlap", "flag", 0), 10.0)]
    begun = [Begun(cell("overlap", "flag", 1), 5.0, 0.4, 4.0)]
    waiting = [cell("overlap", "flag", seed) for seed in (2, 3, 4)]
    assert time_left(waiting, begun, took, 2) == 20.0


def test_a_cell_that_takes_longer_than_others_did_counts_by_its_own_checkpoints() -> None:
    took = [Took(cell("overlap", "flag", 0), 10.0)]
    assert time_left([], [Begun(cell("overlap", "flag", 1), 30.0, 0.5, 25.0)], took, 1) == 20.0


def test_a_task_of_which_nothing_is_known_is_compared_by_its_steps() -> None:
    took = [Took(cell("hold-disc", "flag", 0), 8.0)]
    waiting = [cell("robot-nav", "flag", 0)]
    assert time_left(waiting, [], took, 1, lambda each: STEPS[each.task.name]) == pytest.approx(50.0)
    assert time_left(waiting, [], took, 1) == pytest.approx(8.0)
