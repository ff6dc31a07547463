"""What a formula is like."""

from __future__ import annotations

import pytest

from stlbench import stl
from stlbench.task.forms import TRAITS, traits


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("F[0,9] x >= 1", ""),
        ("F[0,9] G[0,3] x >= 1", "stay"),
        ("F[0,9] x >= 1 & G[0,9] y <= 1", "invariant"),
        ("F[0,9] x >= 1 & F[9,20] x <= 0", "several goals"),
        ("F[0,9] x >= 1 & F[5,20] x <= 0", "several goals, windows that overlap"),
        ("F[0,9] (x >= 1 & F[0,9] x <= 0)", "one after another, several goals, windows that overlap"),
        ("F[0,9] (G[0,3] x >= 1 | G[0,3] x <= 0)", "choice, stay, several goals, windows that overlap"),
        ("G[0,20] F[0,5] x >= 1", "again and again"),
        ("G[0,20] (x >= 1 -> F[0,5] x <= 0)", "again and again, choice, several goals, windows that overlap"),
        ("G[4,9] x >= 1 & G[10,12] x <= 0", "fixed times, several goals"),
        ("x <= 1 U[0,9] y >= 1", "until, invariant"),
        ("F[5,5] x >= 1 & F[5,5] y <= 1", "several goals, windows that overlap"),
        ("F[5,5] x >= 1 & F[6,6] y <= 1", "several goals"),
        ("F[5,5] x >= 1 & F[0,5] y <= 1", "several goals"),
    ],
)
def test_the_traits_of_a_form(text: str, expected: str) -> None:
    found = traits(stl.parse(text))
    assert found <= {*TRAITS}
    assert found == frozenset(filter(None, expected.split(", ")))


def test_places_and_numbers_change_nothing() -> None:
    one, other = "F[0,9] G[0,3] norm(x - 1, y) <= 1", "F[0,90] G[0,2] abs(x) <= 0.1"
    assert traits(stl.parse(one)) == traits(stl.parse(other))
