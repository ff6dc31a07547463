"""The formula's view: its columns by hand, its size, and what it does not depend on."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench.contract import Array
from stlbench.stl import parse
from stlbench.task.view import FEW_GOALS, FormulaView, bent_columns

BOX = {"x": (-10.0, 10.0), "y": (-10.0, 10.0)}
STEPS = 100


def _view(formula: str) -> FormulaView:
    return FormulaView(parse(formula), BOX, STEPS)


def _at(formula: str, x: float, y: float, t: int, state: tuple[float, ...] = ()) -> Array:
    columns: Array = _view(formula)(np.array([state]), np.array([[x, y]]), np.array([t]))[0]
    return columns


def _squashed(value: float) -> float:
    return float(value / np.sqrt(1 + value * value))


def test_one_goal_by_hand() -> None:
    formula = "F[20,50] abs(x) <= 4"  # the margin is in [-6, 4], the argument in [-10, 10]
    margin = [(4 - 8) / 6, _squashed((4 - 8) / 4)]
    argument = [8 / 10, _squashed(8 / 4)]
    clock = [_squashed(value) for value in (0.1 / 0.25, 0.4 / 0.25, 0.1 / 0.03, 0.4 / 0.03)]
    np.testing.assert_allclose(_at(formula, 8.0, 0.0, 10), [*margin, *argument, *clock])
    products = [_squashed(8 / 4) * each for each in (0.5, -1.0)]
    np.testing.assert_allclose(_at(formula, 8.0, 0.0, 10, (0.5, -1.0))[-2:], products)


def test_goals_take_turns_in_the_same_columns() -> None:
    formula = "F[0,20] norm(x - 5, y) <= 1 & F[30,60] norm(x + 5, y - 2) <= 1"
    ahead, back = _at(formula, 5.5, 0.5, 10), _at(formula, -4.5, 2.5, 50)
    assert _view(formula).quantities == (
        *("margin of norm(x - 5, y) <= 1", "x - 5", "y"),
        *("margin of norm(x + 5, y - 2) <= 1", "x + 5", "y - 2"),
    )
    width = 2 * 3  # each quantity at two sizes
    slot = slice(2 * width, 3 * width)
    np.testing.assert_allclose(ahead[slot][1::2], back[slot][1::2])  # at the near size, which both goals share
    np.testing.assert_array_equal(ahead[3 * width :][:2], [1, -1])
    np.testing.assert_array_equal(back[3 * width :][:2], [-1, 1])


def test_goals_over_different_signals_have_columns_of_their_own() -> None:
    formula = "F[0,20] abs(x) <= 1 & F[30,60] abs(y) <= 1"
    early, late = _at(formula, 5.0, 7.0, 10), _at(formula, 5.0, 7.0, 50)
    assert len(early) == 2 * (2 * 2 + 4)  # a margin and an argument at two sizes, four of the clock
    np.testing.assert_array_equal(early[:4], late[:4])


def test_many_goals_grow_the_view_only_by_their_number() -> None:
    def size(goals: int) -> int:
        formula = " & ".join(f"F[0,{10 + i}] norm(x - {i}, y) <= 1" for i in range(goals))
        return len(_at(formula, 0.0, 0.0, 0))

    assert size(FEW_GOALS + 3) - size(FEW_GOALS + 2) == 1
    assert size(FEW_GOALS + 1) < size(FEW_GOALS)


def test_an_invariant_alone_shows_its_margins() -> None:
    np.testing.assert_allclose(_at("G[0,100] x <= 4", 3.0, 0.0, 7), [1 / 14, _squashed(1 / 6)])


@pytest.mark.parametrize(
    "formula",
    [
        *("G[0,50] (F[0,20] x >= 1 & F[0,20] y >= 1)", "x >= 0 U[0,50] y >= 0"),
        "F[0,9] (G[0,5] x >= 1 | G[0,5] y >= 1)",
        *("G[0,50] (x >= 1 -> F[0,9] y >= 1)", "F[10,50] O[0,5] x >= 1", "G[0,90] x / y <= 1", "F[0,100] 0 <= 1"),
    ],
)
def test_every_kind_of_formula_has_a_view_of_numbers_from_minus_1_to_1(formula: str) -> None:
    generator = np.random.default_rng(0)
    signals, t = generator.uniform(-10, 10, (64, 2)), generator.integers(0, STEPS + 1, 64)
    columns = _view(formula)(generator.uniform(-1, 1, (64, 3)), signals, t)
    assert (abs(columns) <= 1).all()
    rows = [_view(formula)(np.zeros((1, 3)), signals[[i]], t[[i]]) for i in range(5)]
    assert {row.shape[1] for row in rows} == {columns.shape[1]}


def test_only_what_the_signals_do_not_say_is_multiplied() -> None:
    signals = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    state = np.stack([signals[:, 0], 3 - 2 * signals[:, 1], np.cos(3 * signals[:, 0]), np.ones(50)], axis=1)
    assert bent_columns(state, signals).tolist() == [False, False, True, False]


def test_all_numbers_are_multiplied_if_a_walk_leaves_the_finite_ones() -> None:
    signals = np.random.default_rng(0).uniform(-1, 1, (50, 2))
    state = np.stack([signals[:, 0], np.where(np.arange(50) < 49, 1.0, np.inf)], axis=1)
    assert bent_columns(state, signals).tolist() == [True, True]
    assert bent_columns(signals, np.where(signals > 0.9, np.nan, signals)).tolist() == [True, True]
