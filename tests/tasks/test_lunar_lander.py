"""Gymnasium's lunar lander with the requirements of Berducci et al."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array
from stlbench.simulation import baselines, referee
from stlbench.simulation.worlds import make_world
from stlbench.task import build_method, load_task

pytest.importorskip("Box2D", reason="the extra field is not installed")
TASK = load_task("lunar-lander")


def test_the_source() -> None:
    """The requirements, with intervals of ours, over 600 of the environment's 1000 steps of 1/50 s."""
    written = "G[0,600] (collision <= 0 & abs(x) <= 1) & F[0,500] G[0,100] (abs(x) <= 0.15 & abs(y) <= 0.05)"
    assert TASK.formula == stl.parse(written)
    assert TASK.file.steps == 600 == stl.horizon(TASK.formula)
    environment = gymnasium.make("LunarLanderContinuous-v3")
    assert environment.metadata["render_fps"] * TASK.file.sampling_time == 1
    assert (TASK.actions.low, TASK.actions.high) == ((-1, -1), (1, 1))


def test_a_fall_is_a_collision_whose_sample_stays() -> None:
    """With its engines off it crashes, as Gymnasium says by -100; the episode ends, and the formula is violated."""
    world = make_world(TASK, 2)
    world.restart(np.arange(2), np.array([[0.0], [1.0]]))
    samples = world.advance(np.full((2, 2), -1.0), 400)
    assert samples[0, :, 2].tolist() == [0, 0]
    assert world.ended.all()
    assert world.signals[:, 2].tolist() == [1, 1]
    assert np.array_equal(samples[world.lived.max() + 1 :], np.tile(samples[-1], (400 - world.lived.max(), 1, 1)))
    environment = gymnasium.make("LunarLanderContinuous-v3")
    environment.reset(seed=0)
    steps, terminated = 0, False
    while not terminated:
        observation, reward, terminated, _, _ = environment.step(np.array([-1.0, -1.0], dtype=np.float32))
        steps += 1
    assert (steps, reward) == (world.lived[0], -100)
    assert world.signals[0, :2] == pytest.approx(observation[:2])


def flight(x: float, y: float, landed: int) -> Array:
    """A trace that is high above (x, 0) until a step, and from then on at (x, y)."""
    trace = np.zeros((1, 601, 3))
    trace[0, :, 0], trace[0, :, 1] = x, np.where(np.arange(601) < landed, 1.0, y)
    return trace


@pytest.mark.parametrize(
    ("trace", "satisfied"),
    [
        (flight(0.1, 0.0, 500), True),
        (flight(0.1, 0.0, 501), False),  # 100 samples are one too few
        (flight(0.2, 0.0, 300), False),  # beside the pad
        (flight(0.1, 0.06, 300), False),
    ],
)
def test_satisfaction_by_hand(trace: Array, satisfied: bool) -> None:
    for formula in (TASK.formula, TASK.specification.formula):
        assert stl.satisfied(formula, trace, TASK.signals).tolist() == [satisfied]
    assert stl.robustness(TASK.formula, trace, TASK.signals)[0] <= 0  # by collision <= 0, which is 0 at best
    trace[0, 550, 2] = 1.0
    assert not stl.satisfied(TASK.formula, trace, TASK.signals).any()


def test_no_place_is_paid_less_than_a_crash() -> None:
    """The margin of the pad is -1.55 in the highest corner, where no lander goes, and -1.35 above the pad."""
    raw = build_method(TASK, "raw")
    t = np.full(3, 300)
    high, low, crashed = raw.arrival(np.array([[0.0, 1.4, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), t)
    assert (high, low, crashed) == pytest.approx((-1.35, 0.05, -1.5))


def test_the_controller_lands_from_nearly_every_start() -> None:
    """Where it is not on the pad it is beside it."""
    begun = TASK.starts.report_and_selection()[1][:16]
    found = baselines.record_controller(TASK, begun)
    assert found is not None
    score = referee.score(TASK, found.traces, lasted=found.lasted)
    assert np.mean(score.satisfied) >= 0.9
    assert max(score.robustness) == 0
