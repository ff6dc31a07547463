"""The local search for what is best known of a task."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.studies import load

from stlbench.contract import ActionGrid
from stlbench.simulation import baselines
from stlbench.task import load_task

HELD = load("held")


@pytest.mark.parametrize("name", ["reach-stay", "cartpole"])
def test_changes_stay_within_the_actions(name: str) -> None:
    task = load_task(name)
    low, high = np.array(task.actions.low), np.array(task.actions.high)
    generator = np.random.default_rng(0)
    before = generator.uniform(low, high, (200, 12, len(low)))
    if isinstance(task.actions, ActionGrid):
        before = task.actions.vectors[HELD.taken(task, before)]
    after = HELD._changed(before.copy(), task.actions, generator)
    assert after.shape == before.shape
    assert ((after >= low) & (after <= high)).all()
    assert (after != before).any(axis=(1, 2)).mean() > 0.5
    if isinstance(task.actions, ActionGrid):
        np.testing.assert_allclose(after, task.actions.vectors[HELD.taken(task, after)], atol=1e-12)


def test_changes_take_over_what_other_sequences_do() -> None:
    """Of sequences that each do one thing all the time, other values come from others: as blocks, or to the end."""
    task = load_task("cartpole")
    before = np.linspace(-0.9, 0.9, 400)[:, None, None] * np.ones((1, 12, 1)) * np.array(task.actions.high)
    values = before[:, 0, 0]
    after = HELD._changed(before.copy(), task.actions, np.random.default_rng(0))[:, :, 0]
    foreign = np.isin(after, values) & (after != values[:, None])
    took = foreign.any(axis=1)
    assert 0.1 < took.mean() < 0.3
    runs = [np.flatnonzero(row) for row in foreign[took]]
    assert all(run[-1] - run[0] + 1 == len(run) for run in runs)  # one block
    assert {int(run[-1]) for run in runs} > {11, 5}  # up to the end, and not
    assert all(len({*row[run]}) == 1 for row, run in zip(after[took], runs, strict=True))  # of one other


def test_crossed_begins_with_the_best_of_all_starts() -> None:
    task = load_task("reach-stay")
    begun = task.starts.report_and_selection()[0][:5]
    pool = load("best_known").by_hand(task, task.starts.report_and_selection()[0])[[3, 7, 11]]
    found = HELD.robustness_of(task, begun, HELD.crossed(task, begun, pool))
    each = [HELD.robustness_of(task, begun, np.repeat(one[None], 5, axis=0)) for one in pool]
    np.testing.assert_array_equal(found, np.max(each, axis=0))
    zero = np.zeros_like(pool[:1]).repeat(5, axis=0)
    mixed = HELD.better(task, begun, zero, HELD.crossed(task, begun, pool))
    most = np.maximum(found, HELD.robustness_of(task, begun, zero))
    np.testing.assert_array_equal(HELD.robustness_of(task, begun, mixed), most)


def test_searching_makes_no_start_worse() -> None:
    task = load_task("reach-stay")
    begun = task.starts.report_and_selection()[0]
    zero = np.tile(baselines.zero(task), (len(begun), task.file.decisions, 1))
    found = HELD.search(task, begun, zero, 0.3)
    was, value = (HELD.robustness_of(task, begun, each) for each in (zero, found))
    assert (value >= was).all()
    assert value.mean() > was.mean()


def test_the_robustness_is_the_referee_s() -> None:
    task = load_task("reach-stay")
    begun = task.starts.report_and_selection()[0]
    sequences = load("best_known").by_hand(task, begun)
    np.testing.assert_array_equal(HELD.robustness_of(task, begun, sequences), HELD.replay(task, sequences).robustness)
