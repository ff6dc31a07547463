"""The unit of a formula's robustness, from the units of its signals."""

from __future__ import annotations

import pytest
from helpers.line_task import line

from stlbench.report.figures.regions import UNKNOWN, robustness_unit, scale_of_task
from stlbench.task import load_task

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
