"""Three robots that go to goals of their own in turn and keep their distances."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.controlled_traces import all_starts, trace

from stlbench import stl
from stlbench.contract import ActionGrid, Array
from stlbench.simulation import referee
from stlbench.task import load_task

TASK = load_task("formation")
GOALS = (4.0, 3.5, 4.0, 2.25, 4.0, 1.0)


def test_one_formula_over_all_robots() -> None:
    safe = [
        f"norm({p}x - {q}x, {p}y - {q}y) {bound}"
        for bound in (">= 0.4", "<= 3")
        for p, q in (("a", "b"), ("b", "c"), ("a", "c"))
    ]
    goals = "G[40,50] norm(ax - 4, ay - 3.5) <= 0.5 & G[80,90] norm(bx - 4, by - 2.25) <= 0.5 & "
    goals += "G[120,130] norm(cx - 4, cy - 1) <= 0.5"
    assert TASK.formula == stl.parse(f"G[0,130] ({' & '.join(safe)}) & {goals}")
    assert (TASK.file.steps, list(TASK.file.robots)) == (130, ["a", "b", "c"])
    assert isinstance(TASK.actions, ActionGrid)
    parts = [(part.names, part.size) for part in TASK.actions.parts]
    assert parts == [((f"v{robot}_x", f"v{robot}_y"), 25) for robot in "abc"]


HOME = np.array(GOALS)


def stays(*stops: tuple[int, Array]) -> Array:
    """A trace that is at each point from the step before it on."""
    trace = np.empty((1, 131, 6))
    for step, point in stops:
        trace[0, step:] = point
    return trace


def moved(robot: str, dx: float, dy: float) -> Array:
    """All robots at their goals, but for one that is so far off."""
    point, column = HOME.copy(), 2 * "abc".index(robot)
    point[column : column + 2] += dx, dy
    return point


@pytest.mark.parametrize(
    ("trace", "robustness"),
    [
        (stays((0, HOME)), 0.5),  # goals 1.25 m apart, the first and the last 2.5 m: 0.5 of at most 3 m
        (stays((0, HOME), (70, moved("b", 0, -1.0)), (80, HOME)), -0.15),  # .25 m from c
        (stays((0, HOME), (91, moved("b", 0, 1.05)), (92, HOME)), -0.2),  # .2 m from a
        (stays((0, HOME), (100, moved("a", 0, 1.5))), -1.0),  # 4 m from c
        (stays((0, HOME), (51, moved("a", 0.9, 0.3))), 3 - math.hypot(0.9, 2.8)),  # from c
        (stays((0, moved("a", 0.6, 0)), (41, HOME)), -0.1),  # a step late
        (stays((0, moved("b", 0.6, 0)), (80, HOME), (90, moved("b", 0.7, 0))), -0.2),  # a step early
        (stays((0, moved("c", -0.6, 0.8)), (120, HOME), (130, moved("c", 0.6, 0))), -0.1),
    ],
)
def test_robustness_by_hand(trace: Array, robustness: float) -> None:
    assert stl.robustness(TASK.formula, trace, TASK.signals) == pytest.approx(robustness)


def test_what_is_rewarded() -> None:
    """Ten times what the distances leave, tightened by .1 m, from -1 to .1; the goals' distance over 6."""
    random = np.random.default_rng(0).uniform(0, 3, (300, 6))
    robust = [stl.margin(term.psi, TASK.signals)(random) for term in stl.fragment(TASK.formula)]
    rewarded = [TASK.specification.margin(term.psi)(random) for term in TASK.specification.terms]
    assert rewarded[0] == pytest.approx(10 * np.clip(robust[0] - 0.1, -0.1, 0.01))
    assert (robust[0].min() < 0, robust[0].max() > 0.11) == (True, True)
    assert rewarded[1:] == [pytest.approx(value / 6) for value in robust[1:]]


def test_features_by_hand() -> None:
    """a 3 m left of its goal, b at its goal, c .5 m below its goal."""
    state = np.tile([1.0, 3.5, 4.0, 2.25, 4.0, 0.5], (4, 1))
    features = TASK.system.features(state, np.array([0, 49, 50, 90]))
    assert features.shape == (4, 27)
    assert features[:, 24:].tolist() == [[1, -1, -1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]
    assert features[0, :6] == pytest.approx([0.6, 0, 0, 0, 0, 0.1])
    assert features[0, 6:12] == pytest.approx([math.tanh(6), 0, 0, 0, 0, math.tanh(1)])
    apart = {"ab": (3, -1.25), "bc": (0, -1.75), "ac": (3, -3)}
    flat = [math.tanh(value / 2) for pair in apart.values() for value in pair]
    assert features[0, 12:18] == pytest.approx(flat)
    distances = [math.hypot(*pair) for pair in apart.values()]
    assert features[0, 18:21] == pytest.approx([math.tanh(2 * (value - 0.4)) for value in distances])
    assert features[0, 21:24] == pytest.approx([math.tanh(2 * (3 - value)) for value in distances])


def test_the_others_have_to_follow() -> None:
    """Once the first robot is at its goal, the second one is too far away where it started."""
    states = all_starts(TASK)
    states[:, :2] = HOME[:2]
    assert (np.hypot(states[:, 0] - states[:, 2], states[:, 1] - states[:, 3]) > 3).mean() > 0.8
    assert (stl.margin(TASK.specification.terms[0].psi, TASK.signals)(all_starts(TASK)) > 0).all()


def test_the_controller_by_hand() -> None:
    """First a goes right, then up as well; b waits 20 steps; c goes to its stops."""
    state = np.tile([1.0, 1.0, 1.0, 2.25, 1.5, 3.5], (4, 1))
    action = TASK.system.controller(state, np.array([0, 5, 20, 50]))
    assert action is not None
    first = [[1, 0, 0, 0, 0.5, -0.5], [1, 1, 0, 0, 0.5, -0.5], [1, 1, 1, 0, 0.5, -0.5], [1, 1, 1, 0, 0.5, -1]]
    assert action.tolist() == first


def test_the_controller_satisfies_from_every_start() -> None:
    """Within .18 m of every goal; the start of the first and the last robot may leave less than the goals do."""
    states = all_starts(TASK)
    score = referee.score(TASK, trace(TASK, states))
    assert all(score.satisfied)
    possible = np.minimum(3 - np.hypot(states[:, 0] - states[:, 4], states[:, 1] - states[:, 5]), 0.32)
    assert (np.array(score.robustness) >= possible - 0.1).all()
    assert np.mean(score.robustness) > 0.31
