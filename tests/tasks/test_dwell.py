"""The noisy unicycle that stays in one of two regions (Ikemoto, Ushio 2022)."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array
from stlbench.task import load_task

TASK = load_task("dwell")


def test_the_source() -> None:
    """F[0,450] (G[0,49] A | G[0,49] B) over 500 steps, with the robot and the starts of patrol."""
    a, b = (f"(x >= 3.5 & x <= 4.5 & y >= {low} & y <= {low + 1})" for low in (3.5, 1.5))
    traces = np.random.default_rng(0).uniform(1.4, 4.6, (20, 501, 2))
    written = stl.parse(f"F[0,450] (G[0,49] {a} | G[0,49] {b})")
    one, other_ = (stl.robustness(formula, traces, TASK.signals) for formula in (TASK.formula, written))
    assert one == pytest.approx(other_)
    other = load_task("patrol")
    assert (TASK.file.steps, TASK.file.sampling_time) == (500, other.file.sampling_time)
    assert (TASK.file.initial, TASK.actions) == (other.file.initial, other.actions)


def visit(*spans: tuple[int, int, float]) -> Array:
    """A trace that is .2 m off a region's centre, at this y, in these spans of steps, and between the regions else."""
    points = np.full((1, 501, 2), [4.2, 3.0])
    for first, last, y in spans:
        points[0, first : last + 1, 1] = y
    return points


@pytest.mark.parametrize(
    ("spans", "robustness"),
    [
        ([(100, 149, 4.0)], 0.3),
        ([(451, 500, 2.0)], -0.5),  # one step too late for F[0,450]
        ([(450, 499, 2.0)], 0.3),
        ([(100, 148, 4.0)], -0.5),  # 49 samples are one too few
        ([(100, 130, 4.0), (132, 170, 4.0)], -0.5),
    ],
)
def test_a_visit_counts_that_lasts_50_samples(spans: list[tuple[int, int, float]], robustness: float) -> None:
    for formula in (TASK.formula, TASK.specification.formula):
        assert stl.robustness(formula, visit(*spans), TASK.signals) == pytest.approx(robustness)


def test_only_a_jump_from_region_to_region_tells_the_rewarded_form_from_the_formula() -> None:
    """25 samples in each: one disjunction inside G holds, neither G does. No step of the robot is 1 m long."""
    jump = visit((100, 124, 4.0), (125, 149, 2.0))
    assert stl.robustness(TASK.specification.formula, jump, TASK.signals) == pytest.approx(0.3)
    assert stl.robustness(TASK.formula, jump, TASK.signals) == pytest.approx(-0.5)
    (term,) = TASK.specification.terms
    assert (term.kind, term.a, term.c1, term.c2, term.b) == ("FG", 0, 450, 0, 49)
