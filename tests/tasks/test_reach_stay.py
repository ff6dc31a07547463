"""Reach a disc and stay: the third form of the paper's fragment, F[a,c1] G[c2,b]."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array
from stlbench.task import load_task

TASK = load_task("reach-stay")


def test_it_is_one_term_of_the_third_form() -> None:
    (term,) = TASK.specification.terms
    assert (term.kind, term.a, term.c1, term.c2, term.b) == ("FG", 0, 600, 0, 200)
    assert term.psi == stl.parse("norm(x - 10, y - 10) <= 1")
    assert TASK.file.steps == term.end == 800


def test_it_is_the_robot_and_the_starts_of_robot_nav() -> None:
    other = load_task("robot-nav")
    assert TASK.file.initial == other.file.initial
    assert TASK.actions == other.actions
    assert (TASK.file.sampling_time, TASK.file.hold) == (other.file.sampling_time, other.file.hold)


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


def test_features_by_hand() -> None:
    """From (7, 6) the centre is 5 m off in direction (3, 4)."""
    to = math.atan2(4, 3)
    state = np.array([[7.0, 6.0, to], [7.0, 6.0, to - math.pi / 2], [10.0, 10.0, 2.0]])
    features = TASK.system.features(state, np.array([0, 400, 800]))
    near = math.tanh(5)
    expected = [[-0.5, near, near, 0, 1], [-0.5, near, 0, near, 0], [-1, 0, 0, 0, math.cos(2)]]
    assert features == pytest.approx(np.array(expected), abs=1e-12)


def test_the_controller_turns_then_drives() -> None:
    """Looking aside of the centre by 1 rad: turn; by -.2: both; away from it, .1 m off: back, 1 m/s."""
    diagonal = math.pi / 4
    state = np.array([[0.0, 0.0, diagonal - 1], [0.0, 0.0, diagonal + 0.2], [10.1, 10.0, 0.0]])
    action = TASK.system.controller(state, np.zeros(3, dtype=np.int64))
    assert action is not None
    assert action == pytest.approx(np.array([[0, 3], [5, -2], [-1, 0]]))
