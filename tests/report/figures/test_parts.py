"""The parts of formulas that pictures show, worked out by hand."""

from __future__ import annotations

import pytest
from helpers.line_task import line

from stlbench.report.figures.regions import parts


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("G[1,2] x >= 0 & F[1,2] G[3,4] x >= 1", [("G[1,2] x >= 0", 1, 2), ("F[1,2] G[3,4] x >= 1", 4, 6)]),
        ("F[0,5] (x <= 1 | x >= 3)", [("F[0,5] x <= 1 | x >= 3", 0, 5)]),
        (
            "G[0,3] (F[1,2] x >= 0 & F[0,2] x <= 1 & x <= 4)",
            [("G[0,3] F[1,2] x >= 0", 1, 5), ("G[0,3] F[0,2] x <= 1", 0, 5), ("G[0,3] x <= 4", 0, 3)],
        ),
        ("F[0,1] (G[0,3] x >= 0 | G[0,2] x <= 1)", [("F[0,1] G[0,3] x >= 0", 0, 4), ("F[0,1] G[0,2] x <= 1", 0, 3)]),
        ("x >= 0 U[2,4] x >= 3", [("until U[2,4] x >= 0", 0, 4), ("U[2,4] x >= 3", 2, 4)]),
        ("!F[1,2] x >= 0", [("G[1,2] !x >= 0", 1, 2)]),
        ("F[0,1] x >= 2 -> G[0,3] x >= 1", [("G[0,1] !x >= 2", 0, 1), ("G[0,3] x >= 1", 0, 3)]),
        ("!(x >= 0 U[2,4] x >= 3)", [("releases R[2,4] !x >= 0", 0, 4), ("R[2,4] !x >= 3", 2, 4)]),
    ],
)
def test_parts(formula, expected):
    found = parts(line(formula=formula))
    assert [(str(part), part.start, part.end) for part in found] == expected
