"""The paper's tasks by hand, a row each: formulas, actions, features, motions, and what controllers do."""

from __future__ import annotations

from dataclasses import replace
from math import atan2, cos, log, pi, sqrt, tanh
from typing import Any

import numpy as np
import pytest
from helpers.mujoco_task import check_no_memory

from stlbench import stl
from stlbench.contract import ActionGrid
from stlbench.task import load_task

ROBOT: dict[str, tuple[float, ...]] = {"v": (-5, 5, 21), "omega": (-3, 3, 13)}
POLE = "abs(theta) <= 0.1 & abs(omega) <= 0.5"
STILL = "abs(omega) <= 0.05"
SAFE = "norminf(x - 2, y - 2) <= 2"
for place in ("x - 2, y - 2", "x - 2, y - 0.5", "x - 3, y - 3"):
    SAFE += f" & norminf({place}) >= 0.5"

SOURCES: dict[str, tuple[str, float, int, dict[str, tuple[float, ...]]]] = {
    "annulus": ("G[300,2000] (norm(x - 5, y - 5) >= 2 & norm(x - 5, y - 5) <= 5)", 0.01, 2000, ROBOT),
    "ball-in-cup": (
        "G[200,300] (distance <= 0.1) & G[500,600] (distance >= 0.2) & G[800,1000] (distance <= 0.1)",
        *(0.02, 1000, dict.fromkeys(("x", "z"), (-1, 1))),
    ),
    "cartpole": (
        f"G[400,500] (abs(x - 0.5) <= 0.2 & {POLE}) & G[900,1000] (abs(x + 0.5) <= 0.2 & {POLE})",
        *(0.01, 1000, {"force": (-1, 1)}),
    ),
    "fetch-reach": (
        "G[50,100] (norm(x - 1.5, y - 0.43, z - 0.47) <= 0.1) & G[150,200] (norm(x - 1.5, y - 1.05, z - 0.47) <= 0.1)",
        *(0.04, 200, dict.fromkeys(("x", "y", "z"), (-1, 1))),
    ),
    "hold-disc": ("G[0,200] (norm(x - 2, y - 2) <= 1)", 0.01, 200, ROBOT),
    "integrator-or": ("G[0,2000] (abs(x - 5) <= 5 | abs(x - 45) <= 5)", 0.01, 2000, {"v": (-3, 3, 13)}),
    "overlap": (
        f"G[0,2000] ({SAFE}) & F[0,1000] (norm(x - 3, y - 1) <= 0.3) & F[1000,1800] (norm(x - 1, y - 3) <= 0.3)",
        *(0.05, 2000, {"v": (-0.3, 0.3, 21), "omega": (-1, 1, 13)}),
    ),
    "pendulum": (
        f"G[400,700] (abs(theta) <= 0.05 & {STILL}) & G[1000,1200] (abs(1.57 - theta) <= 0.05 & {STILL})"
        f" & G[1700,2000] (abs(-1.57 - theta) <= 0.05 & {STILL})",
        *(0.01, 2000, {"torque": (-3, 3, 61)}),
    ),
    "reach-stay": ("F[0,600] G[0,200] norm(x - 10, y - 10) <= 1", 0.01, 800, ROBOT),
    "robot-nav": (
        "G[900,1300] (norm(x - 25, y - 25) <= 2) & G[1600,2000] (norm(x - 30, y - 30) <= 2)",
        *(0.01, 2000, ROBOT),
    ),
}
"""Task -> formula in steps, seconds a step, steps of an episode, and of each action its ends and how many there are."""
CUT = ("ball-in-cup", "cartpole", "fetch-reach", "pendulum")
"""Tasks whose returns are cut where a term ends: from then on the reward, eq. 15, speaks of the next target."""


@pytest.mark.parametrize("name", SOURCES)
def test_what_the_paper_says(name: str) -> None:
    task, (formula, sampling_time, steps, actions) = load_task(name), SOURCES[name]
    assert task.formula == stl.parse(formula)
    assert (task.file.sampling_time, task.file.steps) == (sampling_time, steps)
    if isinstance(task.actions, ActionGrid):
        assert task.actions.names == tuple(actions)
        for axis, (low, high, count) in zip(task.actions.axes, actions.values(), strict=True):
            assert axis == pytest.approx(np.linspace(low, high, int(count)), abs=1e-12)
    else:
        assert list(zip(task.actions.low, task.actions.high, strict=True)) == list(actions.values())
    if name in CUT:
        assert (*task.file.training.cuts, steps) == tuple(term.end for term in task.specification.terms)


def test_starts_and_ranges_of_the_paper() -> None:
    """The robot of eq. 19 starts anywhere in [0,15] x [0,15]; gamma_0 of the pendulum's first interval is pi."""
    region = load_task("annulus").file.initial
    assert region is not None
    assert (region.low[:2].tolist(), region.high[:2].tolist()) == ([0, 0], [15, 15])
    pendulum = load_task("pendulum")
    low, high = replace(pendulum.specification, formula=pendulum.formula).range(stl.fragment(pendulum.formula)[0].psi)
    assert high - low == pytest.approx(pi)
    assert load_task("overlap").file.hold * load_task("overlap").file.sampling_time == 0.5


def test_the_coarse_disc_has_sampling_time_and_turning_rates_of_the_authors_program() -> None:
    fine, coarse = load_task("hold-disc"), load_task("hold-disc-coarse")
    words = {"title", "notes", "agents", "best_known", "baselines", "budgets"}
    one, other = (task.file.model_dump(exclude=words) for task in (fine, coarse))
    assert {key for key in one if one[key] != other[key]} == {"sampling_time", "actions"}
    assert fine.budget("quick") == coarse.budget("quick")
    assert coarse.file.sampling_time == 0.1
    assert one["actions"]["v"] == other["actions"]["v"]
    assert isinstance(coarse.actions, ActionGrid)
    assert coarse.actions.axes[1] == (-3, -2.25, -1.5, -0.75, 0, 0.75, 1.5, 2.25, 3)  # as in RECIPES.md


NEAR, HALF, FAR = tanh(5), tanh(2.5), sqrt(145)
AHEAD, AWAY = atan2(4, 3), atan2(4, 3) + pi
CART = [0.3, 0.5, sqrt(0.75), -0.4, 1.5]
ARM = [0.3, -0.6, 0, 0.4, -0.8, 0, tanh(0.5)]


@pytest.mark.parametrize(
    ("name", "states", "steps", "expected"),
    [
        (  # from (8, 9) the centre is 5 m off in direction (-3, -4); from (5, 5) it is here
            "annulus",
            [[8, 9, AHEAD], [8, 9, AHEAD + pi / 2], [5, 5, 1], [5, 8.5, 0]],
            [0, 1000, 2000, 0],
            [[0.3, tanh(1.5), -NEAR, 0], [0.3, tanh(1.5), 0, NEAR], [-0.7, tanh(-3.5), 0, 0], [0, 0, 0, -tanh(3.5)]],
        ),
        (
            "ball-in-cup",
            [[0.1, -0.2, 0, 0, 1, -2, 3, -4, 0, 0, 0, 0, 0.05, -0.25]] * 4,
            [299, 300, 599, 600],
            [[0.3, -0.6, 0.2, -1, 0.5, -1, 1.5, -2, sign] for sign in (1, -1, -1, 1)],
        ),
        (
            "cartpole",
            [[0.3, pi / 6, -0.4, 3, 0, 0]] * 2,
            [499, 500],
            [[*CART, tanh(-1), NEAR, 1], [*CART, tanh(4), NEAR, -1]],
        ),
        (
            "fetch-reach",
            [[0] * 45 + [1.45, 0.55, 0.5, 0.5, -1, 0]] * 2,
            [99, 100],
            [[*ARM, tanh(-1.2), tanh(-0.3), -1], [*ARM, NEAR, tanh(-0.3), 1]],
        ),
        (  # at (2, 1) looking along x, along y and back: the centre is 1 m to the left, ahead, to the right
            "hold-disc",
            [[2, 1, 0], [2, 1, pi / 2], [2, 1, pi]],
            [0, 0, 0],
            [[0, 1, 0, NEAR], [1, 0, NEAR, 0], [0, -1, 0, -NEAR]],
        ),
        ("integrator-or", [[5], [45]], [0, 0], [[-1, 0, -1], [1, 1, 0]]),
        (  # from (7, 6) the centre is 5 m off in direction (3, 4)
            "reach-stay",
            [[7, 6, AHEAD], [7, 6, AHEAD - pi / 2], [10, 10, 2]],
            [0, 400, 800],
            [[-0.5, NEAR, NEAR, 0, 1], [-0.5, NEAR, 0, NEAR, 0], [-1, 0, 0, 0, cos(2)]],
        ),
        (  # from (22, 21): (25, 25) is 5 m off in direction (3, 4), (30, 30) is sqrt(145) m off in direction (8, 9)
            "robot-nav",
            [[22, 21, AHEAD], [22, 21, AHEAD - pi / 2], [22, 21, AHEAD]],
            [0, 1299, 1300],
            [
                [5 / 20 - 1, HALF, NEAR, 0, 1, -1],
                [5 / 20 - 1, HALF, 0, NEAR, 0, -1],
                [FAR / 20 - 1, tanh(FAR / 2), 60 / 5 / FAR, (3 * 9 - 4 * 8) / 5 / FAR, 60 / 5 / FAR, 1],
            ],
        ),
    ],
)
def test_features_by_hand(name: str, states: Any, steps: list[int], expected: Any) -> None:
    features = load_task(name).system.features(np.array(states, dtype=float), np.array(steps))
    assert features == pytest.approx(np.array(expected), abs=1e-9)


def test_features_of_the_pendulum_by_hand() -> None:
    """At (1, -2): errors 1, -.57, 2.57 of the three phases, which begin at 0, 700 and 1200.

    The deadline is log(pi) at the start of each phase, log(.05) at its interval, about log(.03) at its end; over 2,
    plus 1.
    """
    system, t = load_task("pendulum").system, np.array([0, 699, 700, 1199, 1200, 1700])
    features = system.features(np.tile([1.0, -2.0], (6, 1)), t)
    errors = np.array([1, 1, -0.57, -0.57, 2.57, 2.57])
    assert pytest.approx(np.array([errors / 2, np.tanh(errors / 0.3), np.tanh(errors / 0.05)])) == features[:, :3].T
    assert features[:, 3:6] == pytest.approx(np.tile([-1, tanh(-2 / 0.3), tanh(-40)], (6, 1)))
    assert features[:, 6].tolist() == [-1, -1, 0, 0, 1, 1]
    deadline = system.features(np.zeros((7, 2)), np.array([0, 700, 1200, 400, 1000, 1700, 700 - 1]))[:, 7]
    assert deadline[:6] == pytest.approx([log(pi) / 2 + 1] * 3 + [log(0.05) / 2 + 1] * 3)
    assert deadline[6] == pytest.approx(log(0.03) / 2 + 1, abs=0.02)


@pytest.mark.parametrize(
    ("name", "states", "steps", "actions"),
    [
        # facing the centre from (12, 5): ahead; from (6, 5): back; from (8.2, 5): .3 m in a tenth of a second, 3 m/s
        ("annulus", [[12, 5, pi], [6, 5, pi], [8.2, 5, 0]], [0, 0, 0], [[5, 0], [-5, 0], [3, 0]]),
        # to the nearer point as fast as it may; .2 off: 2 m/s for a tenth of a second
        ("integrator-or", [[24], [26], [5.2]], [0, 0, 0], [[-3], [3], [-2]]),
        # below the passage: turn to it; in it: drive on; after 50 s, at the first goal: back to the passage
        (
            "overlap",
            [[1.15, 0.8, 0.2], [2, 1.25, 0], [2, 1.25, 0], [0.8, 2, pi / 2]],
            [0, 999, 1000, 1000],
            [[0, 1], [0.3, 0], [-0.3, 0], [0.3, 0]],
        ),
        # upright at rest: no torque; at .1 and rest, omega should be -.3 after a step: -.3 / .01 = -30 rad/s^2, less
        # 19.6 sin .1 = 1.957, is -31.957 * .0375 = -1.198
        ("pendulum", [[0, 0], [0.1, 0], [0, 0]], [0, 0, 700], [[0], [-1.2], [3]]),
        # looking aside of the centre by 1 rad: turn; by -.2: both; away from it, .1 m off: back, 1 m/s
        (
            "reach-stay",
            [[0, 0, pi / 4 - 1], [0, 0, pi / 4 + 0.2], [10.1, 10, 0]],
            [0, 0, 0],
            [[0, 3], [5, -2], [-1, 0]],
        ),
        # between the regions' centres, looking along the diagonal: ahead to the second one, back to the first one
        ("robot-nav", [[27.5, 27.5, pi / 4]] * 2, [1300, 1299], [[5, 0], [-5, 0]]),
    ],
)
def test_controllers_by_hand(name: str, states: Any, steps: list[int], actions: Any) -> None:
    action = load_task(name).system.controller(np.array(states, dtype=float), np.array(steps))
    assert action is not None
    assert action == pytest.approx(np.array(actions, dtype=float))


@pytest.mark.parametrize(
    ("name", "states", "actions", "after"),
    [
        # x' = x + v, v' = v + u; a speed stays at 1
        ("either-or", [[2, 3, 0.25, -0.8]], [[0.5, -0.5]], [[2.25, 2.2, 0.75, -1]]),
        ("formation", [range(6)], [[1, -1, 0.5, 0, -0.5, 1]], [[0.1, 0.9, 2.05, 3, 3.95, 5.1]]),
        ("integrator-or", [[0], [25]], [[3], [-0.5]], [[0.03], [24.995]]),
        (  # g/l = 19.6, m l^2 = .0375, mu/(m l^2) = 4/3; omega moves theta one step later
            "pendulum",
            [[0, 0], [pi / 2, 3], [pi / 6, 0], [4, -100]],
            [[3], [0], [-0.75], [0]],
            [[0, 0.8], [pi / 2 + 0.03, 3.196 - 0.04], [pi / 6, 0.098 - 0.2], [3, -100 + 0.196 * np.sin(4) + 4 / 3]],
        ),
    ],
)
def test_motions_by_hand(name: str, states: Any, actions: Any, after: Any) -> None:
    task, begun = load_task(name), np.array(states, dtype=float)
    moved = task.system.step(begun, np.array(actions, dtype=float))
    assert moved == pytest.approx(np.array(after))
    assert task.system.signals(begun).tolist() == begun[:, : len(task.signals)].tolist()


@pytest.mark.parametrize(("radius", "robustness"), [(3.5, 1.5), (2.25, 0.25), (4.0, 1.0), (1.0, -1.0), (7.0, -2.0)])
def test_robustness_on_a_circle_is_the_distance_to_the_nearer_edge_of_the_annulus(
    radius: float, robustness: float
) -> None:
    """From step 300 on."""
    task, angle = load_task("annulus"), np.linspace(0, 20, 2001)
    circle = 5 + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)[None]
    circle[:, :300] = 15
    assert stl.robustness(task.formula, circle, task.signals) == pytest.approx(robustness)


@pytest.mark.parametrize(("name", "steps"), [("ball-in-cup", 60), ("cartpole", 60), ("fetch-reach", 20)])
def test_copies_of_a_mujoco_task_do_not_disturb_each_other(name: str, steps: int) -> None:
    check_no_memory(load_task(name), steps)
