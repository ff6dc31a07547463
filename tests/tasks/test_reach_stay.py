"""Reach a disc and stay: the third form of the paper's fragment, F[a,c1] G[c2,b]."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array
from stlbench.task import load_task

TASK = load_task("reach-stay")


def test_it_is_one_term_of_the_third_form_with_the_robot_and_the_starts_of_robot_nav() -> None:
    (term,) = TASK.specification.terms
    assert (term.kind, term.a, term.c1, term.c2, term.b, term.end) == ("FG", 0, 600, 0, 200, TASK.file.steps)
    other = load_task("robot-nav")
    assert (TASK.file.initial, TASK.actions, TASK.file.hold) == (other.file.initial, other.actions, other.file.hold)


def visit(*spans: tuple[int, int]) -> Array:
    """A trace that is .25 m from the disc's centre in these spans of steps, both ends included, and 4 m off else."""
    x = np.full((1, 801, 2), 10.0)
    x[..., 0] = 6
    for first, last in spans:
        x[0, first : last + 1, 0] = 9.75
    return x


@pytest.mark.parametrize(
    ("spans", "robustness"),
    [
        ([(0, 200)], 0.75),
        ([(600, 800)], 0.75),
        ([(601, 800)], -3.0),
        ([(300, 499)], -3.0),  # 200 samples are one too few
        ([(100, 250), (252, 452)], 0.75),
        ([(100, 250), (252, 400)], -3.0),
    ],
)
def test_a_visit_counts_that_lasts_201_samples(spans: list[tuple[int, int]], robustness: float) -> None:
    assert stl.robustness(TASK.formula, visit(*spans), TASK.signals) == pytest.approx(robustness)
