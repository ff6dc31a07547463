"""The local search for what is best known of a task."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.studies import load

from stlbench.contract import ActionGrid
from stlbench.rollout import baselines
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


def test_searching_makes_no_start_worse() -> None:
    task = load_task("reach-stay")
    begun = task.starts.report_and_selection()[0]
    zero = np.tile(baselines.zero(task), (len(begun), task.file.steps // task.file.hold, 1))
    found = HELD.search(task, begun, zero, 0.3)
    was, value = (HELD.robustness_of(task, begun, each) for each in (zero, found))
    assert (value >= was).all()
    assert value.mean() > was.mean()


def test_the_robustness_is_the_referee_s() -> None:
    task = load_task("reach-stay")
    begun = task.starts.report_and_selection()[0]
    sequences = load("best_known").by_hand(task, begun)
    np.testing.assert_array_equal(HELD.robustness_of(task, begun, sequences), HELD.replay(task, sequences).robustness)
