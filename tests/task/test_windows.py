"""Windows: when the formula reads its parts, by hand, and the formula rebuilt of its own parts."""

from __future__ import annotations

import pytest
from helpers.generated_formulas import formulas, naive, traces
from hypothesis import given, settings
from hypothesis import strategies as st

from stlbench.stl import Formula, parse
from stlbench.task.forms import windows, with_parts


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("G[0,9] x >= 0", [("x >= 0", 0, 9, True)]),
        ("G[2,9] x >= 0", [("x >= 0", 2, 9, False)]),
        ("F[0,9] x >= 0", [("x >= 0", 0, 9, False)]),
        ("F[1,4] G[2,3] (x >= 0 & y >= 0)", [("x >= 0 & y >= 0", 3, 7, False)]),
        ("G[0,9] x >= 0 & F[3,5] y >= 0", [("x >= 0", 0, 9, True), ("y >= 0", 3, 5, False)]),
        ("G[0,9] x >= 0 | F[3,5] y >= 0", [("x >= 0", 0, 9, False), ("y >= 0", 3, 5, False)]),
        ("!F[0,9] x >= 0", [("!x >= 0", 0, 9, True)]),
        ("G[0,5] (x >= 0 -> F[0,3] y >= 0)", [("!x >= 0", 0, 5, False), ("y >= 0", 0, 8, False)]),
        ("x >= 0 U[2,6] y >= 0", [("x >= 0", 0, 5, True), ("y >= 0", 2, 6, False)]),
        ("x >= 0 R[0,6] y >= 0", [("x >= 0", 0, 5, False), ("y >= 0", 0, 6, True)]),
        ("G[5,9] O[1,2] x >= 0", [("x >= 0", 3, 8, False)]),
        ("x >= 0", [("x >= 0", 0, 0, False)]),
        # of one sample, F is G, and an until is its right side
        ("G[0,0] x >= 0 & F[0,0] x >= 1", [("x >= 0", 0, 0, False), ("x >= 1", 0, 0, False)]),
        ("G[5,5] x >= 0 & F[9,9] x >= 1", [("x >= 0", 5, 5, False), ("x >= 1", 9, 9, False)]),
        ("G[0,9] F[0,0] x >= 0", [("x >= 0", 0, 9, True)]),
        ("F[0,0] G[0,9] x >= 0", [("x >= 0", 0, 9, True)]),
        ("G[0,9] F[2,2] x >= 0", [("x >= 0", 2, 11, False)]),
        ("G[0,9] (x >= 0 U[0,0] y >= 0)", [("x >= 0", 0, 9, False), ("y >= 0", 0, 9, True)]),
        ("G[0,9] H[0,0] x >= 0 & G[0,9] O[0,0] y >= 0", [("x >= 0", 0, 9, True), ("y >= 0", 0, 9, True)]),
    ],
)
def test_by_hand(formula: str, expected: list[tuple[str, int, int, bool]]) -> None:
    found = [(str(window.psi), window.begin, window.end, window.invariant) for window in windows(parse(formula))]
    assert found == expected


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("G[2,9] x >= 0", [True]),
        ("F[2,9] x >= 0", [False]),
        ("F[1,4] G[2,3] x >= 0", [False]),
        ("F[4,4] G[2,3] x >= 0", [True]),
        ("G[2,9] (x >= 0 & F[0,3] y >= 0)", [True, False]),
        ("G[2,9] x >= 0 | G[2,9] y >= 0", [False, False]),
        ("x >= 0 U[2,6] y >= 0", [False, False]),
        ("G[5,9] O[1,2] x >= 0 & G[5,9] H[1,2] y >= 0", [False, True]),
    ],
)
def test_a_window_is_throughout_where_each_of_its_samples_counts(formula: str, expected: list[bool]) -> None:
    assert [window.throughout for window in windows(parse(formula))] == expected


@settings(max_examples=40)
@given(formulas(longest=3), st.integers(0, 2**32 - 1))
def test_rebuilt_of_its_own_parts_it_means_the_same(formula: Formula, seed: int) -> None:
    trace = traces(20, seed)
    rebuilt = with_parts(formula, lambda window: window.psi)
    assert naive(rebuilt, trace, 0) == pytest.approx(naive(formula, trace, 0), nan_ok=True)
