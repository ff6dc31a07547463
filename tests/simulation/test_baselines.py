"""What needs no policy, on a point on a line where the best constant action can be worked out by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.line_task import Line, line

from stlbench.contract import Array
from stlbench.simulation import baselines
from stlbench.task.task import Task

BOX = {"v": {"low": -1, "high": 1}}


@pytest.mark.parametrize(
    ("axis", "zero"),
    [
        ({"low": -1, "high": 1, "count": 3}, 0.0),
        ({"low": -1, "high": 2, "count": 3}, 0.5),
        ({"low": 1, "high": 4, "count": 4}, 2.0),
        ({"low": -1, "high": 2}, 0.0),
        ({"low": 1, "high": 4}, 2.5),
    ],
)
def test_zero_is_the_nearest_action_or_the_middle_of_an_axis_that_leaves_it_out(
    axis: dict[str, Any], zero: float
) -> None:
    assert baselines.zero(line(actions={"v": axis})).tolist() == [zero]


def test_the_best_of_a_grid_is_found_and_scored_from_the_starts_of_the_report() -> None:
    """From x in [-1, 1] to 4 at step 6 or later, .5 v a step: only v = 1 comes near, by x + 4 at step 8."""
    task = line(formula="F[0,8] (x >= 3)")
    begun = task.starts.report_and_selection()[0][:, 0]
    found = baselines.constants(task)
    assert found.action == (1.0,)
    assert found.best.robustness == pytest.approx(begun + 4 - 3)
    assert found.zero.robustness == pytest.approx(begun - 3)
    assert not found.zero.satisfaction
    assert found.trivial == (found.best.satisfaction >= 0.95)


def test_in_a_box_it_is_found_beyond_corners_and_middle() -> None:
    """To x + 4 v = 1.2 at step 8 from about 0: v = 0.3."""
    task = line(formula="G[8,8] (abs(x - 1.2) <= 0.1)", actions=BOX, initial={"box": {"x": [-0.01, 0.01]}})
    found = baselines.constants(task)
    assert found.action[0] == pytest.approx(0.3, abs=0.01)
    assert (found.best.satisfaction, found.zero.satisfaction, found.trivial) == (1, 0, True)
    assert baselines.constants(task) == found


def test_a_task_whose_zero_satisfies_is_trivial_and_one_of_two_actions_is_not() -> None:
    assert baselines.constants(line(formula="G[0,8] (x <= 2)")).trivial
    there_and_back = line(formula="F[0,8] (x >= 1.5) & F[0,8] (x <= -1.5)", initial={"box": {"x": [-0.1, 0.1]}})
    assert not baselines.constants(there_and_back).trivial


def test_what_the_task_file_states_is_not_measured_again() -> None:
    stated = {
        "zero": {"robustness": -2, "satisfied": 0.25},
        "constant": {"robustness": -1, "satisfied": 0.95, "action": [0.5]},
        "random": {"robustness": -3, "satisfied": 0},
    }

    class Unmoved(Line):
        def step(self, state: Array, action: Array) -> Array:
            raise AssertionError("it is simulated")

    task = replace(line(baselines=stated), dynamics=Unmoved(0.5))
    found = baselines.constants(task)
    assert (found.zero.mean, found.zero.satisfaction, found.best.mean, found.action) == (-2, 0.25, -1, (0.5,))
    assert found.trivial
    assert baselines.at_random(task).mean == -3


def test_actions_at_random_are_even_and_the_same_at_every_call() -> None:
    """Of speeds -1, 0, 1 each in a third of the decisions; in a box all are as likely."""
    for task in (line(starts=64), line(starts=64, actions=BOX)):
        watched, seen = _watched(task)
        first = baselines.at_random(watched)
        speeds = np.concatenate(seen)
        assert abs(speeds.mean()) < 4 * speeds.std() / np.sqrt(speeds.size)
        assert abs((speeds < -1 / 3).mean() - 1 / 3) < 4 * np.sqrt(2 / 9 / speeds.size)
        assert baselines.at_random(watched) == first


def _watched(task: Task) -> tuple[Task, list[Array]]:
    """The task, and the actions that it is given."""
    seen = list[Array]()

    class Watched(Line):
        def step(self, state: Array, action: Array) -> Array:
            seen.append(action)
            return super().step(state, action)

    return replace(task, dynamics=Watched(0.5)), seen
