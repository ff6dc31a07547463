"""stlpy's scenario with two targets, a goal and an obstacle."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest
from helpers.controlled_traces import all_starts, trace
from helpers.studies import load

from stlbench import stl
from stlbench.contract import Array
from stlbench.simulation import referee
from stlbench.task import load_task, starts

TASK = load_task("either-or")


def inside(region: tuple[float, ...]) -> str:
    x_min, x_max, y_min, y_max = region
    return f"(x >= {x_min} & x <= {x_max} & y >= {y_min} & y <= {y_max})"


def test_the_source() -> None:
    """Goal (7,8,8,9), targets (1,2,6,7) and (7,8,4.5,5.5), obstacle (3,5,4,6), T = 20, five steps in a target."""
    first, second, goal = (inside(region) for region in ((1, 2, 6, 7), (7, 8, 4.5, 5.5), (7, 8, 8, 9)))
    written = stl.parse(
        f"F[0,15] (G[0,5] {first} | G[0,5] {second}) & F[0,20] {goal} & G[0,20] !{inside((3, 5, 4, 6))}"
    )
    traces = np.random.default_rng(0).uniform(0, 10, (50, 21, 2))
    expected = stl.robustness(written, traces, TASK.signals)
    assert stl.robustness(TASK.formula, traces, TASK.signals) == pytest.approx(expected)
    assert (TASK.file.sampling_time, TASK.file.steps, TASK.file.hold) == (1, 20, 1)
    assert (TASK.actions.low, TASK.actions.high) == ((-0.5, -0.5), (0.5, 0.5))
    own = TASK.file.protocols["stlpy"].initial
    assert own is not None
    assert starts.grid(own, 1).tolist() == [[2, 2, 0, 0]]
    assert np.array_equal((TASK.file.initial.low + TASK.file.initial.high) / 2, own.low)


def walk(*places: tuple[float, float, int]) -> Array:
    """A trace that is at each place for so many samples."""
    return np.concatenate([np.tile([x, y], (count, 1)) for x, y, count in places])[None]


def test_robustness_by_hand() -> None:
    """.3 in a target for six samples, .4 in the goal; in a target for five samples only; through the obstacle."""
    good = walk((2, 2, 5), (7.7, 4.8, 6), (7.5, 8.6, 10))
    assert stl.robustness(TASK.formula, good, TASK.signals) == pytest.approx(0.3)
    short = walk((2, 2, 5), (7.5, 5, 5), (7.5, 8.6, 11))
    assert stl.robustness(TASK.formula, short, TASK.signals) < 0
    through = walk((2, 2, 4), (4, 4.2, 1), (7.5, 5, 6), (7.5, 8.6, 10))
    assert stl.robustness(TASK.formula, through, TASK.signals) == pytest.approx(-0.2)


def test_no_more_is_possible_than_half_a_target_and_the_controller_reaches_it() -> None:
    """A target is 1 m wide, so 0.5 bounds the robustness; that is stlpy's optimum too."""
    best = TASK.file.best_known
    assert best is not None
    score = referee.score(TASK, trace(TASK, all_starts(TASK)))
    assert score.robustness == pytest.approx([0.5] * 128)
    assert (best.robustness, best.upper_bound) == (0.5, 0.5)


def test_the_rewarded_form_is_in_the_fragment_and_differs_only_for_jumps() -> None:
    kinds = [(term.kind, term.start, term.end) for term in TASK.specification.terms]
    assert kinds == [("FG", 0, 20), ("F", 0, 20), ("G", 0, 20)]
    jump = walk((2, 2, 5), (1.5, 6.5, 3), (7.5, 5, 3), (7.5, 8.5, 10))
    assert stl.satisfied(TASK.specification.formula, jump, TASK.signals).all()
    assert not stl.satisfied(TASK.formula, jump, TASK.signals).any()


def test_features_by_hand() -> None:
    """From (7.5, 5): in the second target, 3.5 m right of the obstacle's centre and 2.5 m off its edge."""
    (features,) = TASK.system.features(np.array([[7.5, 5.0, 0.5, -1.0]]), np.zeros(1, dtype=np.int64))
    assert features[:4] == pytest.approx([0.5, 0, 0.5, -1])
    assert features[4:10] == pytest.approx(np.tanh([-6, 1.5, 0, 0, 0, 3.5]))
    assert features[10:] == pytest.approx([-0.7, 0, np.tanh(-3.5), 0, np.tanh(5)])


@pytest.fixture(scope="module")
def programme() -> ModuleType:
    return load("either_or")


def test_the_programmes_optimum_is_the_best_possible_and_its_replay_agrees(programme: ModuleType) -> None:
    value, forces = programme.solve(programme.TARGETS[1:])
    assert value == pytest.approx(0.5, abs=1e-6)
    assert programme.replayed(forces) == pytest.approx(value, abs=1e-6)
