"""Overlapping intervals among obstacles, sec. IV-B of the paper."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array
from stlbench.task import load_task

TASK = load_task("overlap")
GOAL_1, GOAL_2, ASIDE = (3.0, 1.0), (1.0, 3.0), (1.0, 1.0)


def stays(*stops: tuple[int, tuple[float, float]]) -> Array:
    """A trace that is at each point from the step before it on."""
    trace = np.empty((1, 2001, 2))
    for step, point in stops:
        trace[0, step:] = point
    return trace


@pytest.mark.parametrize(
    ("trace", "robustness"),
    [
        (stays((0, ASIDE), (900, GOAL_1), (1100, GOAL_2)), 0.3),  # the goals' radius; safety allows .5
        (stays((0, ASIDE), (1000, GOAL_1), (1001, ASIDE), (1800, (1.0, 2.8)), (1801, ASIDE)), 0.1),
        (stays((0, ASIDE), (1001, GOAL_1), (1100, GOAL_2)), 0.3 - 2),  # a step late
        (stays((0, ASIDE), (900, GOAL_1), (1000, ASIDE), (1801, GOAL_2)), 0.3 - 2),
        (stays((0, GOAL_1), (500, (2.0, 1.6)), (501, GOAL_1), (1100, GOAL_2)), -0.1),  # .1 inside an obstacle
        (stays((0, GOAL_1), (1100, GOAL_2), (2000, (4.25, 3.0))), -0.25),  # out of the room at the end
    ],
)
def test_robustness_by_hand(trace: Array, robustness: float) -> None:
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(robustness)


def margins(*points: tuple[float, float]) -> list[list[float]]:
    """What reward methods see of safety, the first and the second goal at some points."""
    values = [TASK.specification.margin(term.psi)(np.array(points)) for term in TASK.specification.terms]
    return [value.tolist() for value in values]


def test_clearance_is_rewarded_up_to_a_passage() -> None:
    """Five times what it is above .22 m, at most .012 and at least -.2 of it."""
    safety, _, _ = margins((1.0, 1.0), (2.0, 1.25), (2.0, 1.2), (2.0, 1.1), (2.0, 1.6), (3.0, 1.0))
    assert safety == pytest.approx([0.06, 0.06, -0.1, -0.6, -1, 0.06])


def test_what_is_rewarded_implies_the_formula() -> None:
    random = np.random.default_rng(0).uniform(0, 4, (3000, 2))
    robust = [stl.margin(term.psi, TASK.signals)(random) for term in stl.fragment(TASK.formula)]
    safety, first, second = (TASK.specification.margin(term.psi)(random) for term in TASK.specification.terms)
    assert ((safety >= 0) == (robust[0] >= 0.22)).all()
    assert first == pytest.approx(np.maximum(robust[1] / 4.3, -0.5))
    assert ((second >= 0) == (robust[2] >= 0)).all()
    left = random[:, 0] <= 1.5
    assert second[left] == pytest.approx(robust[2][left] / 4.5)


def test_the_way_between_two_obstacles_is_longer_than_the_way_back() -> None:
    """From (3,1): nearer to the second goal as the crow flies at the pinch, but farther in what is rewarded."""
    pinch, passage = (2.7, 2.3), (2.0, 1.25)
    assert math.dist(pinch, GOAL_2) < math.dist(passage, GOAL_2)
    _, _, rewarded = margins(pinch, passage)
    assert rewarded[0] < rewarded[1] - 0.2
    expected = math.dist(pinch, GOAL_2) + 0.5 * 1.2 + min(1.2, 1.05)
    assert rewarded[0] == pytest.approx((0.3 - expected) / 4.5)


def test_the_pinch_cannot_be_jumped() -> None:
    """Across (2.5, 2.5), .02 m aside: steps of 15 mm see the obstacle that steps of 150 mm can straddle."""
    fine = np.linspace(-0.45, 0.45, 61)
    across = np.stack([2.5 + (fine + 0.03) / math.sqrt(2), 2.5 - (fine - 0.03) / math.sqrt(2)], axis=-1)
    clearance = stl.margin(stl.fragment(TASK.formula)[0].psi, TASK.signals)
    assert clearance(across[5::10]).min() > 0.01
    assert clearance(across).min() < -0.01
    assert TASK.file.actions["v"].high * TASK.file.sampling_time == pytest.approx(0.015)


def test_features_by_hand() -> None:
    """At (1, 1.25) looking up: the goal (3, 1) is aside to the right, (1, 3) ahead, the passage to the right."""
    features = TASK.system.features(np.tile([1.0, 1.25, math.pi / 2], (2, 1)), np.array([999, 1000]))
    assert features[:, :4] == pytest.approx(np.tile([-0.5, -0.375, 0, 1], (2, 1)))
    assert features[:, 4].tolist() == [-1, 1]
    first, near = math.hypot(2, 0.25), math.tanh(math.hypot(2, 0.25) / 0.3)
    assert features[0, 5:9] == pytest.approx([first / 2 - 1, near, -0.25 / first * near, -2 / first * near])
    assert features[1, 5:9] == pytest.approx([1.75 / 2 - 1, math.tanh(1.75 / 0.3), math.tanh(1.75 / 0.3), 0])
    # .5 m to the obstacles' left edge, x = 1.5, here, ahead and behind; .7 m to the wall from .3 m to the left; on the
    # right y = 1.25 is .25 m from both obstacles' corners
    around = [math.tanh(4 * margin) for margin in (0.5, 0.7, 0.5, 0.25)]
    assert features[0, 9:] == pytest.approx([1, math.tanh(2.5), *around])


def test_the_clearance_that_the_policy_sees_is_the_margin_of_the_safety_term() -> None:
    states = np.random.default_rng(0).uniform(-0.5, 4.5, (300, 3))
    clearance = stl.margin(stl.fragment(TASK.formula)[0].psi, TASK.signals)(states[:, :2])
    assert TASK.system.features(states, np.zeros(300, dtype=np.int64))[:, 9] == pytest.approx(2 * clearance)
