"""What a policy from outside answers: taken as the task's actions, or refused with what is wrong."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from stlbench.contract import ActionBox, ActionGrid, Actions
from stlbench.errors import UsageError
from stlbench.share.actions import Moved, OnObservation, OnState, actions_of, read_actions

GRID = ActionGrid(("v", "w"), ((-1.0, 0.0, 1.0), (0.0, 2.0)))
BOX = ActionBox(("v", "w"), (-1.0, 0.0), (1.0, 2.0))


@pytest.mark.parametrize(
    ("answer", "actions", "expected"),
    [
        ([5, 0, 3], GRID, [5, 0, 3]),  # whole numbers are indices
        (np.array([[-0.9, 1.5], [0.4, 0.9], [0.6, 0.0]], np.float32), GRID, [1, 2, 4]),  # the nearest actions
        (np.array([[0, 1, 2, 9, 4, 5], [7, 1, 2, 3, 4, 5], [0] * 6], np.float32), GRID, [3, 0, 0]),  # greatest values
        ([[1, 2]], BOX, [[1.0, 2.0]]),
        (np.array([[1 + 1e-7, -1e-7]]), BOX, [[1.0, 0.0]]),  # what single precision makes of the ends
    ],
)
def test_what_is_taken(answer: object, actions: Actions, expected: list[object]) -> None:
    found = actions_of(answer, actions, len(expected), "p")
    assert found.tolist() == expected
    assert found.dtype == (np.int64 if actions is GRID else np.float64)


def test_what_is_moved_to_the_grid_is_counted() -> None:
    """By hand: of five answers three are off the grid, w by .5, 1 and .25, v by .1; rounding is no move."""
    moved, units = Moved(), {"v": "m/s", "w": "rad/s"}
    assert moved.text(units, GRID.names) == ""
    for vectors in ([[-1.0, 0.5], [0.9, 1.0 + 1e-9]], [[1.0, 2.0], [0.0, 0.25], [1e-7, 0.0]]):
        actions_of(np.array(vectors), GRID, len(vectors), "p", moved)
    assert (moved.total, moved.moved, moved.farthest.tolist()) == (5, 3, [pytest.approx(0.1), pytest.approx(1.0)])
    said = "3 of 5 actions (60 %) are not on the task's grid, and were moved to the nearest: "
    assert moved.text(units, GRID.names) == said + "v by up to 0.1 m/s, w by up to 1 rad/s"


OWN = "w,v\n0,-0.7\n0.3,0.1\n2,1\n"


@pytest.mark.parametrize("answer", [[1, 2, 0], [[0.0, 5.0, 1.0], [0.0, 1.0, 2.0], [3.0, 0.0, 0.0]]])
@pytest.mark.parametrize("actions", [GRID, BOX])
def test_of_a_table_of_its_own_actions_it_answers_numbers(answer: object, actions: Actions, tmp_path: Path) -> None:
    (tmp_path / "own.csv").write_text(OWN)
    policy = OnObservation(lambda _: answer, actions, "p", read_actions(tmp_path / "own.csv", actions))
    assert policy.act(np.zeros((3, 4))).tolist() == [[0.1, 0.3], [1.0, 2.0], [-0.7, 0.0]]
    assert policy.moved.moved == 0


@pytest.mark.parametrize(
    ("text", "answer", "message"),
    [
        ("v,u\n0,0\n", [0], "there is no column 'w'; the task's actions have v, w"),
        ("v,w,u\n0,0,0\n", [0], "the task's actions have no 'u'; there are: v, w"),
        ("v,w\n0,3\n", [0], r"an action has w 3; w is in \[0, 2\]"),
        ("v,w\n0,a\n", [0], "'a' is no finite number"),
        (OWN, [3], "p: action 3; the task's are 0 to 2"),
        (OWN, [[0.5]], "p: its answers are no whole numbers of the rows of its table"),
    ],
)
def test_a_table_that_does_not_fit(text: str, answer: object, message: str, tmp_path: Path) -> None:
    (tmp_path / "own.csv").write_text(text)
    with pytest.raises(UsageError, match=message):
        OnObservation(lambda _: answer, GRID, "p", read_actions(tmp_path / "own.csv", GRID)).act(np.zeros((1, 4)))


@pytest.mark.parametrize(
    ("found", "actions", "message"),
    [
        ([0, 1], GRID, r"p: its actions are int64 \(2,\); expected are whole .* \(3,\), values \(3, 6\), or \(3, 2\)"),
        ([0, 1, 2], BOX, r"p: its actions are int64 \(3,\); expected are \(3, 2\) for v, w"),
        ([0.0, 1.0, 2.0], GRID, r"are float64 \(3,\); expected are whole"),
        ([[0.0], [1.0], [2.0]], BOX, r"are float64 \(3, 1\); expected are \(3, 2\)"),
        ([0, 6, 1], GRID, "p: action 6; the task's are 0 to 5"),
        ([[0.0] * 5 + [np.nan]] * 3, GRID, "p: a value of an action is NaN"),
        ([0, -1, 1], GRID, "p: action -1; the task's are 0 to 5"),
        ([[0, 0], [0, np.nan], [0, 0]], BOX, r"p: an action has w nan; w is in \[0, 2\]"),
        ([[0, 0], [0, np.nan], [0, 0]], GRID, r"p: an action has w nan; w is in \[0, 2\]"),
        ([[0, 0], [-np.inf, 1], [0, 0]], BOX, r"p: an action has v -inf; v is in \[-1, 1\]"),
        ([[0, 0], [0, 2.1], [1.5, 0]], BOX, r"p: an action has v 1.5; v is in \[-1, 1\]"),
        (["a", "b", "c"], GRID, r"p: its actions are <U1 \(3,\)"),
        ([[1], [1, 2], [3]], BOX, "p: its actions are no array"),
        (None, BOX, r"p: its actions are object \(\)"),
    ],
)
def test_what_is_refused(found: object, actions: ActionGrid | ActionBox, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        actions_of(found, actions, 3, "p")


def test_a_function_that_fails_is_one_line() -> None:
    def fails(observation: object) -> None:
        raise KeyError("first\nsecond")

    with pytest.raises(UsageError) as caught:
        OnObservation(fails, BOX, "mine:act").act(np.zeros((2, 3)))
    assert str(caught.value).startswith("mine:act failed: KeyError: ")
    assert "\n" not in str(caught.value)


def test_a_function_cannot_change_what_it_is_given() -> None:
    def changes(state: np.ndarray, t: np.ndarray) -> np.ndarray:
        state += 1
        t += 1
        return np.zeros((len(state), 2))

    state, t = np.zeros((2, 3)), np.zeros(2, np.int64)
    OnState(changes, BOX, "p").episode()(state, t, np.zeros((2, 0)))
    assert (state.sum(), t.sum()) == (0, 0)
