"""A task's controller in the place of a policy, on a point on a line where its traces can be worked out by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.line_task import Line, Probe, Rule, line, steered
from helpers.walk_task import WalkTask, walk

from stlbench.contract import Array, Integers
from stlbench.records.result import MAIN
from stlbench.simulation import baselines
from stlbench.simulation.faults import PluginFault
from stlbench.simulation.referee import Referee
from stlbench.task.task import Task


def trace(task: Task, *states: float) -> list[list[float]]:
    found = baselines.record_controller(task, np.array(states)[:, None])
    assert found is not None
    rows: list[list[float]] = found.traces[..., 0].tolist()
    return rows


def test_every_step_is_recorded_and_actions_are_held() -> None:
    """Up while x is below 1 at a decision, else down: steps of .5, decided at 0 and 4."""
    task = steered(lambda state, t: np.where(state < 1, 1.0, -1.0), hold=4)
    assert trace(task, 0, 1) == [[0, 0.5, 1, 1.5, 2, 1.5, 1, 0.5, 0], [1, 0.5, 0, -0.5, -1, -0.5, 0, 0.5, 1]]


def test_a_controller_that_changes_the_state_that_it_is_given_changes_no_trace() -> None:
    def control(state: Array, t: Integers) -> Array:
        state[:] = 5.0
        t[:] = 0
        return np.ones((len(state), 1))

    assert trace(steered(control), 0) == [[0, 0.5, 1, 1.5, 2, 2.5, 3, 3.5, 4]]


def test_on_a_grid_the_nearest_action_is_taken() -> None:
    """The grid is -1, 0, 1; whole numbers are speeds, not indices."""
    for wanted, taken in ((0.6, 1), (0.4, 0), (-7.0, -1), (9.0, 1), (-0.51, -1)):
        assert trace(steered(lambda state, t, v=wanted: np.full((len(state), 1), v)), 0)[0][1] == 0.5 * taken
    assert trace(steered(lambda state, t: np.full((len(state), 1), 1)), 0)[0][1] == 0.5


def test_each_axis_of_a_grid_is_rounded_by_itself() -> None:
    task = line(actions={"v": {"low": -1, "high": 1, "count": 3}, "w": {"low": 0, "high": 1, "count": 2}})

    class Sum(Line):
        def step(self, state: Array, action: Array) -> Array:
            return state + self.dt * action.sum(axis=1, keepdims=True)

        def controller(self, state: Array, t: Integers) -> Array:
            return np.array([[0.8, 0.9], [-0.8, 0.1]])

    assert [row[1] for row in trace(replace(task, dynamics=Sum(0.5)), 0, 0)] == [1, -0.5]


def test_continuous_actions_are_clipped_and_not_rounded() -> None:
    box = {"v": {"low": -1, "high": 1}}
    task = steered(lambda state, t: np.where(state > 0, 0.25, 3.0), actions=box)
    assert [row[1] for row in trace(task, 1, 0)] == [1.125, 0.5]


@pytest.mark.parametrize(
    ("control", "message"),
    [
        (lambda state, t: np.full((len(state), 1), np.nan), r"an action has v nan; v is in \[-1, 1\]"),
        (lambda state, t: np.full((len(state), 1), np.inf), r"an action has v inf; v is in \[-1, 1\]"),
        (lambda state, t: np.zeros((len(state), 2)), r"its actions are float64 \(1, 2\); expected are \(1, 1\) for v"),
        (lambda state, t: np.zeros(len(state)), r"its actions are float64 \(1,\); expected are \(1, 1\) for v"),
        (lambda state, t: 1.0, r"its actions are float64 \(\); expected are \(1, 1\) for v"),
        (lambda state, t: [["up"]] * len(state), r"its actions are <U2 \(1, 1\); expected"),
        (lambda state, t: None if t[0] == 3 else np.ones_like(state), "the controller has no action at step 3$"),
    ],
)
@pytest.mark.parametrize("count", [None, 3])
def test_what_is_no_action_is_refused(
    control: Callable[[Array, Integers], Any], message: str, count: int | None
) -> None:
    task = steered(control, actions={"v": {"low": -1, "high": 1, "count": count}})
    with pytest.raises(PluginFault, match=f"^line, by hand: {message}"):
        trace(task, 0)


class Walker(WalkTask):
    """Always takes one action of 0, 1 and 2."""

    def __init__(self, action: Any) -> None:
        super().__init__()
        self.action = action

    def controller(self, observation: Any, info: Any, t: int) -> Any:
        return self.action


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([17], r"an action has action 17; action is in \[0, 2\]"),
        ([-0.1], r"an action has action -0.1; action is in \[0, 2\]"),
        ([np.nan], r"an action has action nan; action is in \[0, 2\]"),
        (1.0, r"its actions are float64 \(1,\); expected are \(1, 1\) for action"),
    ],
)
def test_of_an_environment_actions_out_of_range_are_refused(action: Any, message: str) -> None:
    with pytest.raises(PluginFault, match=f"^walk, by hand: {message}$"):
        trace(walk(Walker(action)), 0)


@pytest.mark.parametrize(("action", "taken"), [(1.4, 0), (1.6, 0.5), (2 + 1e-7, 0.5), (-1e-7, -0.5)])
def test_of_an_environment_the_nearest_action_is_taken(action: float, taken: float) -> None:
    assert trace(walk(Walker([action])), 0)[0][1] == taken


def test_the_score_is_the_one_of_a_policy_that_does_the_same() -> None:
    """Up until step 3, then down, with and without held actions: the referee's report of such a policy."""
    for hold in (1, 2):
        task = steered(lambda state, t: np.where(t[:, None] < 3, 1.0, -1.0), hold=hold, starts=8)
        policy = Rule(lambda seen: np.where(seen[:, 1] < 3, 2, 0))
        report = Referee(task, Probe(task.specification)).assess(policy)
        assert baselines.score_controller(task) == report.scores[MAIN]
        found = baselines.record_controller(task, task.starts.report_and_selection()[0])
        assert found is not None
        assert np.array_equal(found.traces, report.traces)


def test_a_task_without_a_controller() -> None:
    assert baselines.record_controller(line(), np.zeros((2, 1))) is None
    assert baselines.score_controller(line()) is None
