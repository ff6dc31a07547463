"""The derived formula: the same verdicts as the task's, values by hand, and the same for every way to write it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.generated_formulas import formulas, traces
from hypothesis import given, settings
from hypothesis import strategies as st

from stlbench.contract import Array
from stlbench.stl import Formula, margin, parse, satisfied
from stlbench.task.derived import can_fall, derived
from stlbench.task.forms import normal_form, scale, windows

BOX = {"x": (-3.0, 3.0), "y": (-3.0, 3.0), "z": (-3.0, 3.0)}
NAMES = tuple(BOX)
AT_REST = np.array([[2.5, 0.0, 0.0], [2.0, 0.0, 0.0]])
"""Initial samples: x is far from 0, y and z are there."""
PREDICATES = st.sampled_from(
    [
        parse(text)
        for text in (
            *("norm(x - 1, y) <= 1", "abs(x) < 0.5", "x >= 1", "y < -2", "norminf(x, y) > 2", "x - y <= z"),
            *("min(x, z) >= 0.25", "x <= 9", "x >= 9", "0 <= 1", "abs(x) <= 0", "abs(y) >= 0"),
        )
    ]
)


def _derived(formula: Formula | str, initial: Array = AT_REST) -> Formula:
    return derived(parse(formula) if isinstance(formula, str) else formula, BOX, {}, initial)


def _value(formula: str, *sample: float, of: int = 0) -> float:
    """The margin of a window of the derived formula, at a sample that is 0 where nothing is given."""
    psi = windows(_derived(formula))[of].psi
    return float(margin(psi, NAMES)(np.array([*sample, 0.0, 0.0][:3])))


@settings(max_examples=60)
@given(formulas(PREDICATES, longest=3, constants=False), st.integers(0, 2**32 - 1))
def test_the_same_traces_satisfy_it(formula: Formula, seed: int) -> None:
    batch = traces(30, seed, (20,))
    changed = _derived(formula, batch[:, 0])
    assert (satisfied(changed, batch, NAMES) == satisfied(formula, batch, NAMES)).all()


@settings(max_examples=40)
@given(formulas(PREDICATES, longest=3, constants=False, past=False), st.integers(0, 2**32 - 1))
def test_what_satisfies_a_formula_satisfies_what_the_track_auto_derives(formula: Formula, seed: int) -> None:
    batch = traces(30, seed, (20,))
    changed = _derived(normal_form(formula), batch[:, 0])
    assert (satisfied(changed, batch, NAMES) >= satisfied(formula, batch, NAMES)).all()


def test_what_satisfies_the_derived_form_may_not_satisfy_the_formula() -> None:
    """At either step another of the two holds."""
    formula = parse("F[0,0] (G[0,1] x >= 1 | G[0,1] x <= -1)")
    trace = np.array([[[2.0, 0.0, 0.0], [-2.0, 0.0, 0.0]]])
    assert satisfied(_derived(normal_form(formula), trace[:, 0]), trace, NAMES).all()
    assert not satisfied(formula, trace, NAMES).any()


def test_a_goal_by_hand() -> None:
    goal, worst = "F[1,9] norm(x, y) <= 1", scale(parse("norm(x, y) <= 1"), BOX).worst
    assert worst == pytest.approx(math.hypot(3, 3) - 1)
    for x, expected in ((0.0, 0.5), (0.5, 0.25), (1.0, 0.0), (2.0, -0.4 * math.log(2) / math.log(1 + worst))):
        assert _value(goal, x) == pytest.approx(expected)
    assert _value(goal, 3.0, 3.0) == pytest.approx(-0.4)


def test_an_invariant_by_hand() -> None:
    both = "G[0,9] abs(x) >= 1 & F[0,9] y >= 1"  # at most 2 above its border, 1 below: its near size is 1
    values = {3.0: 0.3, 1.5: 0.3, 1.25: 0.15, 1.0: 0.0, 0.995: -0.51, 0.75: -1.5, 0.5: -2, 0: -2}
    assert {x: _value(both, x) for x in values} == pytest.approx(values)


@pytest.mark.parametrize(("hold", "border"), [(1, 1), (2, 2), (5, 5), (10, 5)])
def test_a_shallow_violation_in_one_step_outweighs_a_decision(hold: int, border: float) -> None:
    """The mean over a decision of `hold` steps, of which one is violated, is the cost of the farthest goal."""
    derived_formula = derived(parse("G[0,9] abs(x) >= 1 & F[0,9] y >= 1"), BOX, {}, AT_REST, hold)
    value = margin(windows(derived_formula)[0].psi, NAMES)
    assert value(np.array([0.98, 0.0, 0.0])) == pytest.approx(-border - 0.04)
    assert value(np.array([1.25, 0.0, 0.0])) == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("formula", "falls"),
    [
        ("G[0,9] abs(x) <= 1 & F[0,9] y >= 1", True),
        ("G[0,9] (abs(x) <= 1 & abs(y) >= 1) & F[0,9] y >= 1", True),
        ("G[0,9] abs(x) >= 1 & F[0,9] y >= 1", False),  # an obstacle
        ("G[0,3] abs(x) <= 1 & F[0,9] y >= 1", False),  # less than half of the time
        ("G[1,9] abs(x) <= 1", False),  # a goal
        ("G[0,9] x >= -1 & F[0,9] y >= 1", True),  # at one end
        ("F[0,9] y >= 1", False),
    ],
)
def test_a_robot_can_fall_where_leaving_a_range_violates_an_invariant(formula: str, falls: bool) -> None:
    assert can_fall(parse(formula), BOX) == falls


def test_a_robot_that_can_fall_pays_the_same_however_long_it_holds_an_action() -> None:
    limited = parse("G[0,9] abs(x) <= 1 & F[0,9] y >= 1")
    assert derived(limited, BOX, {}, AT_REST, 5) == derived(limited, BOX, {}, AT_REST, 1)


def test_invariants_of_one_unit_share_the_steepest_scale() -> None:
    both = "G[0,9] (abs(x) >= 1 & abs(x) <= 2.9) & F[0,9] y >= 1"  # the near size of the second is 0.1
    assert _value(both, 0.975) == pytest.approx(-1.5)


def test_beside_invariants_a_goal_costs_as_much_as_their_borders() -> None:
    assert _value("F[0,9] norm(x, y) <= 1 & G[0,9] abs(z) <= 1", 3.0, 3.0) == pytest.approx(-1)


def test_invariants_alone_are_goals() -> None:
    assert _value("G[0,9] norm(x, y) <= 1", 0.5) == pytest.approx(0.25)


def test_a_goal_of_several_predicates_counts_what_all_of_them_can_reach() -> None:
    assert _value("F[1,9] abs(x) <= 1", 0.0) == pytest.approx(0.5)
    assert _value("F[1,9] (abs(x) <= 1 & abs(y) <= 0.1)", 0.95) == pytest.approx(0.25)  # 0.05 of at most 0.1, over 2


def test_what_the_start_keeps_costs_no_more_beyond_four_near_sizes() -> None:
    both = "G[5,9] (abs(x) <= 0.1 & abs(y) <= 0.1)"  # only y is there at the start
    assert _value(both, 0.0, 0.5) == _value(both, 0.0, 3.0) > _value(both, 3.0, 0.0) == _value(both, 3.0, 3.0)


@pytest.mark.parametrize("goal", ["F[1,9] x >= 1", "F[1,9] !(x < 1)"])
def test_a_wide_range_does_not_set_the_scale_of_a_goal(goal: str) -> None:
    """At the start x lacks at most 1: it costs .4 there, at most log 5 / log 3 times as much, and 2 pays all."""
    starts = np.array([[0.0], [0.5]])
    near, wide, wider = (derived(parse(goal), {"x": (-end, end)}, {}, starts) for end in (4.0, 10.0, 1000.0))
    assert near != wide == wider
    (window,) = windows(wide)
    values = margin(window.psi, ["x"])(np.array([[3.0], [2.0], [1.5], [1.0], [0.0], [-1.0], [-9.0]]))
    most = -0.4 * math.log(5) / math.log(3)
    assert values == pytest.approx([0.5, 0.5, 0.25, 0.0, -0.4, most, most])


def test_a_margin_that_is_0_at_best_is_all_or_nothing() -> None:
    assert [_value("G[5,9] abs(x) <= 0", x) for x in (0.0, 1e-6, 3.0)] == [0.3, -1.0, -1.0]


@pytest.mark.parametrize("other", ["1 >= norm(x, y)", "0 <= 1 - norm(x, y)", "norm(x, y) - 1 <= 0", "!norm(x, y) > 1"])
def test_it_is_the_same_for_every_way_to_write_a_predicate(other: str) -> None:
    samples = np.random.default_rng(0).uniform(-3, 3, (50, 3))
    values = [margin(windows(_derived(f"F[1,9] {text}"))[0].psi, NAMES)(samples) for text in ("norm(x, y) <= 1", other)]
    np.testing.assert_allclose(*values, atol=1e-6)
