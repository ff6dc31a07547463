"""The derived formula: the same verdicts as the task's, values by hand, and the same for every way to write it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.generated_formulas import formulas, traces
from hypothesis import given, settings
from hypothesis import strategies as st

from stlbench.stl import Formula, margin, parse, satisfied
from stlbench.task.derived import derived
from stlbench.task.scales import scale

BOX = {"x": (-3.0, 3.0), "y": (-3.0, 3.0), "z": (-3.0, 3.0)}
PREDICATES = st.sampled_from(
    [
        parse(text)
        for text in (
            *("norm(x - 1, y) <= 1", "abs(x) < 0.5", "x >= 1", "y < -2", "norminf(x, y) > 2", "x - y <= z"),
            *("min(x, z) >= 0.25", "x <= 9", "x >= 9", "0 <= 1"),
        )
    ]
)


@settings(max_examples=200)
@given(formulas(PREDICATES, longest=3, constants=False), st.integers(0, 2**32 - 1))
def test_the_same_traces_satisfy_it(formula: Formula, seed: int) -> None:
    batch = traces(30, seed, (20,))
    expected = satisfied(formula, batch, tuple(BOX))
    assert (satisfied(derived(formula, BOX), batch, tuple(BOX)) == expected).all()


def test_a_goal_by_hand() -> None:
    (psi,) = _parts("F[1,9] norm(x, y) <= 1")
    best, worst = 1.0, scale(parse("norm(x, y) <= 1"), BOX).worst
    assert worst == pytest.approx(math.hypot(3, 3) - 1)
    for x, expected in ((0.0, 0.5 * best), (0.5, 0.25), (1.0, 0.0), (2.0, -math.log(2) / math.log(1 + worst))):
        assert _value(psi, x) == pytest.approx(expected)
    assert _value(psi, 3.0, 3.0) == pytest.approx(-1)


def test_an_invariant_by_hand() -> None:
    (psi,) = _parts("G[0,9] abs(x) >= 1")  # at most 2 above its border, 1 below: its near size is 1
    for x, expected in ((3.0, 0.3), (1.5, 0.3), (1.25, 0.15), (1.0, 0.0), (0.75, -0.5), (0.0, -1.0)):
        assert _value(psi, x) == pytest.approx(expected)


def test_a_goal_of_several_predicates_counts_what_all_of_them_can_reach() -> None:
    alone, narrow = (_parts(f"F[1,9] {text}")[0] for text in ("abs(x) <= 1", "(abs(x) <= 1 & abs(y) <= 0.1)"))
    assert _value(alone, 0.0) == pytest.approx(0.5)
    assert _value(narrow, 0.95, 0.0) == pytest.approx(0.25)  # 0.05 of at most 0.1, over 2


@pytest.mark.parametrize("other", ["1 >= norm(x, y)", "0 <= 1 - norm(x, y)", "norm(x, y) - 1 <= 0", "!norm(x, y) > 1"])
def test_it_is_the_same_for_every_way_to_write_a_predicate(other: str) -> None:
    samples = np.random.default_rng(0).uniform(-3, 3, (50, 3))
    values = [margin(_parts(f"F[1,9] {text}")[0], tuple(BOX))(samples) for text in ("norm(x, y) <= 1", other)]
    np.testing.assert_allclose(*values, atol=1e-9)


def _parts(formula: str) -> tuple[Formula, ...]:
    from stlbench.task.windows import windows

    return tuple(window.psi for window in windows(derived(parse(formula), BOX)))


def _value(psi: Formula, x: float, y: float = 0.0) -> float:
    return float(margin(psi, tuple(BOX))(np.array([x, y, 0.0])))
