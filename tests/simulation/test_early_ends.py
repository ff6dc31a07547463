"""Episodes that an environment ends early: what they are paid in training, and how the referee judges them."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.episodes import specification
from helpers.generated_formulas import NAMES, SEEDS, formulas, traces
from helpers.latch import Latch
from helpers.line_task import Probe, Rule
from helpers.walk_task import WalkTask, walk
from hypothesis import given, settings
from hypothesis import strategies as st

from stlbench import stl
from stlbench.contract import Event, Specification
from stlbench.records.result import MAIN, RANDOM
from stlbench.simulation.environment import BatchEnvironment, _Past
from stlbench.simulation.referee import Referee
from stlbench.simulation.verdicts import EarlyEnds, judge, without_end
from stlbench.stl.recorded.evaluator import value_range


@pytest.mark.parametrize(
    ("formula", "greatest", "least"),
    [
        ("G[0,2] x <= 1", 11.0, -9.0),
        ("!(F[0,2] x <= 1)", 9.0, -11.0),
        ("G[0,1] x >= 0 | G[2,3] x <= 0", 10.0, -10.0),
        ("x >= 0 -> F[0,1] y >= 0", 10.0, -1.0),
        ("x >= 0 U[0,3] y >= 0", 1.0, -1.0),
        ("x >= 9 U[2,3] y >= 0", 1.0, -19.0),
        ("y >= 0 U[2,3] x >= 0", 1.0, -10.0),
        ("x >= 0 R[0,3] y >= 0", 1.0, -1.0),
        ("y >= 0 R[2,3] x >= 0", 10.0, -1.0),
        ("G[9,9] (x >= 0 S[0,3] y >= 0)", 1.0, -1.0),
        ("G[9,9] (y >= 0 S[2,3] x >= 0)", 1.0, -np.inf),
        ("True", np.inf, np.inf),
    ],
)
def test_table(formula: str, greatest: float, least: float) -> None:
    box = {"x": (-10.0, 10.0), "y": (-1.0, 1.0)}
    found = value_range(stl.parse(formula), specification(formula, box, steps=9).range)
    assert found == pytest.approx((least, greatest))


@settings(max_examples=40)
@given(formulas(), SEEDS)
def test_no_trace_within_the_ranges_is_outside(formula: stl.Formula, seed: int) -> None:
    steps = stl.horizon(formula)
    box = Specification(formula, tuple(NAMES), (-3.0,) * 3, (3.0,) * 3, max(steps, 1), 1.0)
    low, high = value_range(formula, box.range)
    found = stl.robustness(formula, traces(steps + 1, seed), NAMES)
    assert low - 1e-9 <= found <= high + 1e-9


# --------------------------------------------------------------------------------------------------------- training

WALL = WalkTask(wall=1.0)
"""It ends at x = 1, which from x = 0 is two steps to the right."""
RIGHT_INDEX = 2


@pytest.mark.parametrize(
    ("terminated", "reward", "discount"),
    [
        ("hold", 461.0, 0.0),  # 100 t + 10 + 1 on average at t = 2..7, where x stays 1
        ("violated", -0.5, 0.0),  # the floor
        ("interval", 110.5, 1.0),  # its own, 100 + 10 + .5, and what follows is worth what going on would be
    ],
)
def test_what_training_is_paid_at_an_early_end(terminated: str, reward: float, discount: float) -> None:
    task = walk(WALL, terminated=terminated)
    environment = BatchEnvironment(task, Probe(task.specification), 2, seed=0)
    environment.reset()
    first = environment.step(np.array([RIGHT_INDEX, 1]))
    assert (first.reward.tolist(), first.ended.tolist(), first.cut.tolist()) == ([5, 0], [False] * 2, [False] * 2)
    second = environment.step(np.array([RIGHT_INDEX, 1]))
    assert second.reward.tolist() == [reward, 100]
    assert second.discount.tolist() == [discount, 1]
    assert (second.ended.tolist(), second.cut.tolist()) == ([True, False], [True, False])
    assert second.arrived[0].tolist() == [1 / 50, -1 / 50, -0.5]
    assert second.observation[0].tolist() == [0, 0, -1]


@pytest.mark.parametrize(
    ("formula", "reward"),
    [
        ("F[0,4] x >= 1", 461.0),  # satisfied: as above
        ("F[3,4] x >= 1", 461.0),  # x stays 1
        ("F[0,4] x <= -1", -0.5),  # lost: the floor
        ("F[0,1] x >= 1", -0.5),  # x = 1 comes too late
    ],
)
def test_an_early_end_that_violates_pays_the_floor_on_request(formula: str, reward: float) -> None:
    task = walk(WALL, formula=formula, training={"ends": [{"where": "lost"}]})
    environment = BatchEnvironment(task, Probe(task.specification), 3, seed=0)
    environment.reset()
    for _ in range(2):  # the third copy ends twice, the second episode like the first
        environment.step(np.array([RIGHT_INDEX, 1, RIGHT_INDEX]))
        second = environment.step(np.array([RIGHT_INDEX, 1, RIGHT_INDEX]))
        assert second.reward[[0, 2]].tolist() == [reward] * 2
        assert second.ended.tolist() == [True, False, True]
        assert second.discount.tolist() == [0, 1, 0]


def test_an_early_end_is_lost_by_what_happened_before_it() -> None:
    """With actions held for two steps, the samples within a decision count: x = .5 at step 1."""
    for formula, reward in (("F[1,1] x >= 0.5", True), ("F[1,1] x >= 1", False)):
        task = walk(WALL, formula=formula, hold=2, training={"ends": [{"where": "lost"}]})
        environment = BatchEnvironment(task, Probe(task.specification), 1, seed=0)
        environment.reset()
        step = environment.step(np.array([RIGHT_INDEX]))
        assert step.ended.tolist() == [True]
        assert (step.reward[0] > 0) == reward


def test_an_episode_that_begins_late_is_judged_as_if_it_had_stood_there_before() -> None:
    past = _Past(walk(WALL, formula="G[0,2] x <= 0.5"), 2)
    past.begin(np.arange(2), np.array([[0.0], [0.0]]))
    for t in (1, 2):
        past.add(np.array([[[1.0]], [[0.0]]]), np.array([t, t]))
    assert past.lost(np.array([True, True]), np.array([2, 2])).tolist() == [True, False]
    past.begin(np.array([0]), np.array([[0.5]]))  # at step 3: the samples of the episode before do not count
    past.add(np.array([[[1.0]], [[1.0]]]), np.array([4, 3]))
    assert past.lost(np.array([True, False]), np.array([4, 3])).tolist() == [False, False]


def test_episodes_on_an_environment_may_begin_at_a_random_time() -> None:
    task = walk(training={"exploring": {"share": 0.5}}, hold=2)
    environment = BatchEnvironment(task, Probe(task.specification), 400, seed=0)
    observation, begun = environment.reset(), environment.simulator.t
    assert set(begun.tolist()) == {0, 2, 4, 6}
    assert 0.5 < (begun == 0).mean() < 0.75  # half of all, and a quarter of the others
    assert set(observation[:, 0]) == {0.0}  # all at the environment's own start
    assert np.array_equal(environment.step(np.full(400, 1)).ended, begun == 6)


def test_an_end_at_the_last_step_is_the_time_limit() -> None:
    task = walk(WalkTask(wall=1.0), steps=2, formula="G[0,2] x <= 5")
    environment = BatchEnvironment(task, Probe(task.specification), 1, seed=0)
    environment.reset()
    environment.step(np.array([RIGHT_INDEX]))
    last = environment.step(np.array([RIGHT_INDEX]))
    assert (last.reward.tolist(), last.discount.tolist(), last.ended.tolist()) == ([110.5], [1], [True])


@pytest.mark.parametrize(
    ("terminated", "reward"),
    [
        ("hold", 0.5),  # 1 at the second step, over 2; nothing is left to be paid
        ("violated", 0.0),  # and the floor, -1, but once
        ("interval", 0.5),  # the method says that nothing follows
    ],
)
def test_a_method_that_can_end_is_paid_once(terminated: str, reward: float) -> None:
    task = walk(WALL, terminated=terminated)
    environment = BatchEnvironment(task, Latch(task.specification), 1, seed=0)
    environment.reset()
    assert environment.step(np.array([RIGHT_INDEX])).reward.tolist() == [0.025]
    last = environment.step(np.array([RIGHT_INDEX]))
    assert (last.reward.tolist(), last.event.tolist()) == ([reward], [Event.OVER])


def test_what_is_left_to_a_method_that_can_end() -> None:
    """Five steps at .5: a tenth of it each, and .9 ... .9^5 in all; the floor once; and 1 once at x = 1."""
    method = Latch(specification("G[0,8] x <= 9", {"x": (-10.0, 10.0)}))
    action, open_ = np.zeros((1, 1)), np.zeros((1, 1))
    weights = sum(0.9**i for i in range(1, 6))
    half, one = np.array([0.5]), np.array([1.0])
    assert EarlyEnds(method, "hold").sum_left(half, action, 3, open_, 0.9) == pytest.approx(0.05 * weights)
    assert EarlyEnds(method, "violated").sum_left(half, action, 3, open_, 0.9) == pytest.approx(-0.9)
    assert EarlyEnds(method, "hold").sum_left(one, action, 3, open_, 0.9) == pytest.approx(0.9)
    assert EarlyEnds(method, "hold").sum_left(one, action, 3, np.ones((1, 1)), 0.9) == 0


# ---------------------------------------------------------------------------------------------------------- verdicts


@pytest.mark.parametrize(
    ("terminated", "formula", "robustness", "satisfied", "failed"),
    [
        ("hold", "G[0,4] x <= 0.75", -0.25, False, {"G[0,4] x <= 0.75": 4}),
        ("hold", "G[0,4] x <= 2", 1.0, True, {}),
        ("violated", "G[0,4] x <= 2", -8.0, False, {"ended early": 4}),  # x may be 10
        ("violated", "G[0,4] x <= 0.75", -9.25, False, {"G[0,4] x <= 0.75": 4}),  # before it ended
        ("violated", "G[3,4] x <= 0 & G[0,4] x <= 0.75", -10.0, False, {"G[0,4] x <= 0.75": 4}),
        ("violated", "G[0,4] x <= 11", 0.0, False, {"ended early": 4}),  # which the range alone makes sure
        ("interval", "G[0,4] x <= 0.75", -9.25, False, {"G[0,4] x <= 0.75": 4}),  # violated whatever follows
        ("interval", "G[0,4] x <= 2", -8.0, False, {"ended early, verdict open": 4}),
        ("interval", "F[0,4] x >= 1", 0.0, True, {}),  # satisfied whatever follows
        ("violated", "x >= 5 U[0,4] x <= 0.75", -9.25, False, {"ended early": 4}),  # at the first step x may be 10
    ],
)
def test_how_an_early_end_is_judged(
    terminated: str, formula: str, robustness: float, satisfied: bool, failed: dict[str, int]
) -> None:
    task = walk(WALL, terminated=terminated, formula=formula)
    report = Referee(task, Probe(task.specification)).assess(Rule(lambda seen: RIGHT_INDEX))
    score = report.scores[MAIN]
    assert score.robustness == pytest.approx((robustness,) * 4)
    assert score.satisfied == (satisfied,) * 4
    assert score.first_failed == failed
    assert np.isnan(report.traces[:, 3:]).all() == (terminated != "hold")
    assert np.isfinite(report.traces[:, :3]).all()


@pytest.mark.parametrize("terminated", ["hold", "violated", "interval"])
def test_how_many_ended_before_the_horizon_is_counted(terminated: str) -> None:
    """The wall is reached at step 2: before the horizon of G[0,4], not before that of G[0,2]."""
    protocols = {"short": {"title": "a short one", "formula": "G[0,2] x <= 2"}}
    task = walk(WALL, terminated=terminated, formula="G[0,4] x <= 2", protocols=protocols)
    referee = Referee(task, Probe(task.specification), random_starts=5)
    walled = referee.assess(Rule(lambda seen: RIGHT_INDEX)).scores
    assert {name: score.ended_early for name, score in walled.items()} == {MAIN: 1.0, RANDOM: 1.0, "short": 0.0}
    assert walled[MAIN].satisfied == (terminated == "hold",) * 4
    assert referee.assess(Rule(lambda seen: 1)).scores[MAIN].ended_early == 0.0


@pytest.mark.parametrize("terminated", ["violated", "interval"])
def test_an_early_end_is_never_better_than_what_was_recorded(terminated: str) -> None:
    """x was 1, beyond its range, at the end: -0.75. By the range alone it is 0.25 - 0.9 = -0.65 at least."""
    narrow = {"x": {"low": -0.9, "high": 0.9}}
    task = walk(WALL, terminated=terminated, formula="G[0,4] x <= 0.25", signals=narrow)
    score = Referee(task, Probe(task.specification)).assess(Rule(lambda seen: RIGHT_INDEX)).scores[MAIN]
    assert score.robustness == pytest.approx((-0.75,) * 4)
    assert score.satisfied == (False,) * 4


@settings(max_examples=30)
@given(formulas(), SEEDS, st.integers(0, 5))
def test_within_the_ranges_what_was_recorded_changes_no_bound(formula: stl.Formula, seed: int, last: int) -> None:
    steps = max(stl.horizon(formula), 6)
    box = Specification(formula, tuple(NAMES), (-3.0,) * 3, (3.0,) * 3, steps, 1.0)
    recorded = without_end(traces(steps + 1, seed)[None], np.array([last]))
    least = value_range(formula, box.range)[0]
    assert judge(formula, recorded, box, "violated").robustness.tolist() == [[min(least, 0.0)] * 2]
    ((low, high),) = judge(formula, recorded, box, "interval").robustness
    whole = stl.robustness(formula, traces(steps + 1, seed), NAMES)
    assert low - 1e-9 <= whole <= high + 1e-9


def test_selection_judges_as_the_report_does() -> None:
    task = walk(WALL, terminated="violated", formula="G[0,4] x <= 2")
    referee = Referee(task, Probe(task.specification))
    assert referee.select(Rule(lambda seen: RIGHT_INDEX)) == (0.0, pytest.approx(-8.0))
    assert referee.select(Rule(lambda seen: 1)) == (1.0, 2.0)
