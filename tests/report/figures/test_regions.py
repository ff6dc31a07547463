"""The parts of formulas that pictures show, and the unit of a formula's robustness, by hand."""

from __future__ import annotations

import pytest
from helpers.line_task import line

from stlbench.report.figures.regions import UNKNOWN, parts, robustness_unit, scale_of_task
from stlbench.task import load_task


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


SIGNALS = {name: {"low": -1, "high": 1, "unit": unit} for name, unit in {"x": "m", "y": "m", "w": "rad/s"}.items()}
SIGNALS["n"] = {"low": -1, "high": 1}


@pytest.mark.parametrize(
    ("formula", "unit"),
    [
        ("G[0,4] x <= 1", "m"),
        ("G[0,4] norm(x - 2, y - 2) <= 1", "m"),
        ("F[0,4] 1 >= max(x, -y, 0.5)", "m"),
        ("G[0,4] 2 * x + y / 3 <= x * 4", "m"),
        ("G[0,4] (x <= 1 & abs(w) <= 2)", "m or rad/s"),
        ("F[0,2] w >= 0 & G[0,2] x <= 1 & G[0,2] y <= 1", "rad/s or m"),
        ("G[0,4] n <= 1", "-"),
        ("G[0,4] x * y <= 1", UNKNOWN),
        ("G[0,4] x ** 2 <= 1", UNKNOWN),
        ("G[0,4] x + w <= 1", UNKNOWN),
        ("G[0,4] x <= w", UNKNOWN),
        ("G[0,4] sin(x) <= 1", UNKNOWN),
        ("G[0,4] 1 / x <= 1", UNKNOWN),
        ("G[0,4] (x <= 1 | 1 <= 2)", UNKNOWN),
    ],
)
def test_unit_of_robustness(formula, unit):
    task = line(signals=SIGNALS, formula=formula)
    assert robustness_unit(task, task.formula) == unit


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("hold-disc", "m"),
        ("pendulum", "rad or rad/s"),
        ("cartpole", "m or rad or rad/s"),
        ("formation", "m"),
        ("integrator-or", "-"),
        ("gone", UNKNOWN),
    ],
)
def test_unit_of_a_task(name, unit):
    assert scale_of_task(name, load_task).unit == unit
