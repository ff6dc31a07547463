"""The double integrator that visits places in order, and the unicycle that chooses one of two."""

from __future__ import annotations

import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array
from stlbench.task import load_task
from stlbench_tasks.suite.systems import DoubleIntegrator, Unicycle

CHAIN, CHOICE = load_task("linear-chain"), load_task("unicycle-choice")
A, B, C = (5.0, 2.0), (2.0, 5.0), (5.0, 5.0)
E, F, G, H = (5.0, 1.0), (1.0, 5.0), (5.0, 5.0), (3.0, 1.0)


def trace(steps: int, *stays: tuple[int, tuple[float, float]], columns: int = 2) -> Array:
    """A trace that jumps at these steps to these places."""
    found = np.zeros((steps + 1, columns))
    for at, place in stays:
        found[at:, :2] = place
    return found


def test_the_systems_are_those_of_the_suite() -> None:
    assert type(CHAIN.system).step is DoubleIntegrator.step
    assert type(CHOICE.system).step is Unicycle.step
    for task in (CHAIN, CHOICE):
        assert stl.horizon(task.formula) == task.file.steps


@pytest.mark.parametrize(
    ("stays", "expected"),
    [
        ([(0, A), (80, B), (180, C)], 0.4),
        ([(0, A), (80, (2.3, 5)), (180, C)], 0.1),
        ([(0, A), (80, B), (180, (5, 4.8))], 0.2),
        ([(0, B), (80, A), (180, C)], -2.6),  # B came too early: from A on, the place nearest to it is C, 3 m off
        ([(0, A), (80, B), (281, C)], -2.6),
        ([(0, A), (80, B), (100, (3, 3)), (101, B), (180, C)], -1.0),
    ],
)
def test_the_chain_by_hand(stays: list[tuple[int, tuple[float, float]]], expected: float) -> None:
    found = trace(280, *stays, columns=4)
    assert stl.robustness(CHAIN.formula, found, CHAIN.signals) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("stays", "expected"),
    [
        ([(0, E), (100, G), (180, H)], 0.4),
        ([(0, F), (100, G), (180, H)], 0.4),
        ([(0, (5.1, 1)), (100, G), (180, H)], 0.3),
        ([(0, E), (20, F), (40, G), (180, H)], -3.6),  # 20 samples at each are one too few; G is 4 m off both
        ([(0, E), (21, F), (40, G), (180, H)], 0.4),
        ([(0, E), (100, G), (281, H)], -3.6),  # H is a step too late; E, 2 m off H, is 4 m off G
    ],
)
def test_the_choice_by_hand(stays: list[tuple[int, tuple[float, float]]], expected: float) -> None:
    found = trace(300, *stays)
    assert stl.robustness(CHOICE.formula, found, CHOICE.signals) == pytest.approx(expected)


@pytest.mark.parametrize(("one", "other", "radius"), [(A, B, 1.0), (G, H, 0.9)])
def test_the_obstacle_is_in_the_straight_way(
    one: tuple[float, float], other: tuple[float, float], radius: float
) -> None:
    points = np.linspace(one, other, 1001)
    assert np.linalg.norm(points - 3, axis=1).min() < radius - 0.005


def test_the_ways_by_hand() -> None:
    """The pull is 1.2 a metre, the brake 1.8 a m/s. A robot that looks at its place drives, another turns there."""
    state = np.array([[4.5, 2.0, 0.1, 0.0], [4.8, 4.0, 0.0, 1.0]])
    assert CHAIN.system.controller(state, np.array([0, 70])) == pytest.approx(np.array([[0.42, 0], [0, -0.84]]))
    robots = np.array([[1.0, 0.8, 0.0], [0.8, 1.0, 0.0], [5.0, 4.0, np.pi / 2], [4.0, 1.0, np.pi]])
    actions = CHOICE.system.controller(robots, np.array([0, 0, 120, 200]))
    assert actions == pytest.approx(np.array([[1.0, 0.25], [0, 1.5], [1.0, 0], [1.0, 0]]), abs=0.05)
