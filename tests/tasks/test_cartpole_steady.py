"""Gymnasium's CartPole-v1 with a formula of Tang et al. 2025; Gymnasium is the oracle of the dynamics."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from stlbench import stl
from stlbench.contract import Array
from stlbench.task import load_task
from stlbench_methods.flag import Flag

TASK = load_task("cartpole-steady")


def test_the_source() -> None:
    """The formula, in steps, over the 500 steps of the environment; its forces, its time, its starts."""
    assert TASK.formula == stl.parse("G[0,490] (F[0,10] abs(x_dot) <= 0.1 & abs(x) <= 0.5 & abs(theta) <= 0.1)")
    environment = gymnasium.make("CartPole-v1")
    assert environment.spec is not None
    assert environment.spec.max_episode_steps == TASK.file.steps == stl.horizon(TASK.formula)
    assert environment.unwrapped.tau == TASK.file.sampling_time
    assert TASK.actions.axes == ((-10, 10),)
    assert (TASK.file.initial.low.tolist(), TASK.file.initial.high.tolist()) == ([-0.05] * 4, [0.05] * 4)


@pytest.mark.filterwarnings("ignore:.*already returned terminated")
@pytest.mark.parametrize("seed", range(3))
def test_steps_are_those_of_gymnasium_bit_for_bit(seed: int) -> None:
    """Far beyond the fall: what Gymnasium terminates goes on here as it does there."""
    environment = gymnasium.make("CartPole-v1").unwrapped
    observation, _ = environment.reset(seed=seed)
    state = np.array(environment.state, dtype=np.float64)[None]
    assert np.all((TASK.file.initial.low <= state) & (state <= TASK.file.initial.high))
    ends = list[bool]()
    for push in np.random.default_rng(seed).integers(2, size=200):
        observation, _, over, _, _ = environment.step(int(push))
        state = TASK.system.step(state, np.array([[TASK.actions.axes[0][push]]]))
        assert np.array_equal(state[0], environment.state)
        assert np.array_equal(TASK.system.signals(state)[0].astype(np.float32), observation[:3])
        ends.append(over)
        lost = TASK.file.training.ends[0].where
        assert isinstance(lost, stl.Formula)
        assert stl.holds(lost, TASK.signals)(TASK.system.signals(state))[0] == over
    assert ends[-1]


def test_a_state_that_gymnasium_ends_has_violated_the_formula() -> None:
    """12 degrees are more than 0.1 rad, and 2.4 m are more than 0.5: of what is left only the windows' ends count."""
    for signals in ([2.41, 0, 0], [0, 0, 0.21]):
        upright = np.zeros((1, 501, 3))
        upright[0, 490] = signals
        assert stl.robustness(TASK.formula, upright, TASK.signals) < 0


def steady(x_dot: Array) -> Array:
    """A trace in the middle and upright with these speeds (501,), leaning by .03."""
    return np.stack([np.zeros(501), x_dot, np.full(501, 0.03)], axis=1)[None]


def test_robustness_by_hand() -> None:
    """Fast but for one sample in 11, at .04: .06; in 12: a window without it."""
    speeds = np.full(501, 0.5)
    speeds[10::11] = 0.04
    assert stl.robustness(TASK.formula, steady(speeds), TASK.signals) == pytest.approx(0.06)
    speeds = np.full(501, 0.5)
    speeds[11::12] = 0.04
    assert stl.robustness(TASK.formula, steady(speeds), TASK.signals) == pytest.approx(-0.4)


def test_rewards_of_all_conditions_are_of_one_size_and_flag_reads_them_as_windows() -> None:
    flag = Flag(TASK.specification)
    assert flag.describe() == {"form": "outer operator over windows", "flags": [11, 1]}
    fast = steady(np.full(501, 2.0))
    assert stl.robustness(TASK.specification.formula, fast, TASK.signals) == pytest.approx(-0.1)


def test_features_by_hand() -> None:
    state = np.array([[1.2, -1.0, np.pi / 30, 3.0]])
    features = TASK.system.features(state, np.zeros(1, dtype=np.int64))
    assert features == pytest.approx(np.array([[1.2, -0.5, 0.5, 1.5, *np.tanh([2.4, -5, np.pi / 6])]]))
