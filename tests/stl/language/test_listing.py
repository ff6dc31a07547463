"""A text of several formulas: where one ends and the next begins."""

from __future__ import annotations

import pytest
from helpers.generated_formulas import formulas
from hypothesis import given
from hypothesis import strategies as st

from stlbench import stl
from stlbench.stl.language.parser import listed


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("x > 1\ny > 2", [(1, "x > 1"), (2, "y > 2")]),
        ("# a list\n\nx > 1  # up\n  y > 2#down\n#", [(3, "x > 1"), (4, "y > 2")]),
        ("G[0,3] (x > 1\n  | y > 2  # or this\n)\nz > 0", [(1, "G[0,3] (x > 1 | y > 2 )"), (4, "z > 0")]),
        ("x > 1 &\ny > 2\n-z > 0", [(1, "x > 1 & y > 2"), (3, "-z > 0")]),
        ("x > 1\n\n-> y > 2\n  or z > 0\n(x > 1)", [(1, "x > 1 -> y > 2 or z > 0"), (5, "(x > 1)")]),
        ("x > 1\nU[0,3] y > 2\nU > 1\n!x > 1", [(1, "x > 1 U[0,3] y > 2"), (3, "U > 1"), (4, "!x > 1")]),
        ("G[0,\n3]\nx > 1\nalways\ny > 2\nx > G", [(1, "G[0, 3] x > 1"), (4, "always y > 2"), (6, "x > G")]),
        ("not\nx > 1\nx\n>= 1", [(1, "not x > 1"), (3, "x >= 1")]),
        ("x @ 1\ny > 2\n(z > 1", [(1, "x @ 1"), (2, "y > 2"), (3, "(z > 1")]),
        ("", []),
    ],
)
def test_by_hand(text: str, expected: list[tuple[int, str]]) -> None:
    assert list(listed(text)) == expected


@given(st.lists(formulas(leaves=4, endless=True), min_size=1, max_size=4))
def test_formulas_come_back_from_lines_and_from_broken_lines(several: list[stl.Formula]) -> None:
    lines = "\n# next\n".join(map(str, several))
    assert [stl.parse(text) for _, text in listed(lines)] == several
    broken = "\n".join(f"({str(formula).replace(' & ', f'  # and{chr(10)} & ')})" for formula in several)
    assert [stl.parse(text) for _, text in listed(broken)] == several
