"""Tasks of several robots through PettingZoo: against its own checks, by hand, and against the simulator."""

from __future__ import annotations

import pickle
import subprocess
import sys
import warnings
from typing import Any

import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.spaces import Box, Discrete
from helpers.pair_task import pair
from pettingzoo.test import parallel_api_test, parallel_seed_test

from stlbench import stl
from stlbench.contract import ActionGrid
from stlbench.errors import UsageError
from stlbench.parallel import StlParallelEnv, parallel_env
from stlbench.simulation.environment import Simulator
from stlbench.task import build_method, load_task

METHODS = ["raw", "flag"]


@pytest.fixture
def two(monkeypatch: pytest.MonkeyPatch) -> StlParallelEnv:
    """Two robots on a line, paid by `raw`."""
    monkeypatch.setattr("stlbench.simulation.gymnasium.env.load_task", lambda name: pair())
    return parallel_env("pair", "raw")


def moves(left: int, right: int) -> dict[str, Any]:
    return {"left": np.int64(left), "right": np.int64(right)}


@pytest.mark.parametrize("method", METHODS)
def test_pettingzoo_accepts_it(method: str) -> None:
    with warnings.catch_warnings(action="error"):
        parallel_api_test(parallel_env("formation", method), num_cycles=100)
        parallel_seed_test(lambda: parallel_env("formation", method), num_cycles=40)


@pytest.mark.parametrize("method", METHODS)
def test_it_is_the_simulator_number_for_number(method: str) -> None:
    """Actions given to the simulator as vectors, put together from each robot's own axes by hand."""
    env = parallel_env("formation", method)
    task = load_task("formation")
    simulator = Simulator(task, build_method(task, method))
    speeds, generator = np.array([-1, -0.5, 0, 0.5, 1]), np.random.default_rng(0)
    seen, infos = env.reset(seed=3)
    expected = simulator.reset(infos["a"]["signals"])  # the signals are the state
    np.testing.assert_array_equal(seen["b"], expected[0].astype(np.float32))
    for count in range(1, 27):
        own = generator.integers(25, size=3)
        vector = np.concatenate([[speeds[index // 5], speeds[index % 5]] for index in own])
        seen, rewards, terminated, truncated, infos = env.step(dict(zip("abc", own, strict=True)))
        held = simulator.advance(vector[None])
        for robot in "abc":
            np.testing.assert_array_equal(seen[robot], simulator.observe()[0].astype(np.float32))
            np.testing.assert_array_equal(infos[robot]["signals"], held.samples[0])
            assert infos[robot]["t"] == 5 * count
            assert rewards[robot] == held.reward[0]
            assert (terminated[robot], truncated[robot]) == (False, count == 26)
    assert env.agents == []


def test_a_step_by_hand(two: StlParallelEnv) -> None:
    """`raw` pays the least robust term: .6 - |b + 1| is less than .6 - |a - 1|."""
    assert two.possible_agents == ["left", "right"]
    assert [two.action_space(robot) for robot in two.possible_agents] == [Discrete(3), Discrete(5)]
    _, infos = two.reset(options={"state": [-0.5, 0.5]})
    assert infos["right"]["signals"].tolist() == [[-0.5, 0.5]]
    seen, rewards, _, _, infos = two.step(moves(2, 3))  # 1 m/s and 1 m/s for .5 s
    assert infos["left"]["signals"].tolist() == [[0, 1]]
    assert infos["left"]["t"] == 1
    assert rewards == {"left": pytest.approx(-1.4), "right": pytest.approx(-1.4)}
    assert seen["left"].tolist() == seen["right"].tolist() == [0, 0.25, -0.75]


def test_an_episode_is_a_trace_that_the_formula_scores(two: StlParallelEnv) -> None:
    _, infos = two.reset(options={"state": [-0.5, 0.5]})
    samples = [infos["left"]["signals"]]
    for step in range(8):
        assert two.agents == ["left", "right"]
        _, _, _, truncated, infos = two.step(moves(2, 1) if step < 3 else moves(1, 2))
        samples.append(infos["left"]["signals"])
    assert truncated == {"left": True, "right": True}
    trace = np.concatenate(samples)
    assert trace[[0, 3, 8]].tolist() == [[-0.5, 0.5], [1, -1], [1, -1]]
    # at their goals, .6 inside each
    assert stl.robustness(two.task.formula, trace, two.task.signals) == pytest.approx(0.6)
    with pytest.raises(ResetNeeded):
        two.step(moves(1, 2))


def test_seeds_decide_where_episodes_start(two: StlParallelEnv) -> None:
    first, again = ([two.reset(seed=seed)[1]["left"]["signals"].tolist() for seed in (7, None, 8)] for _ in range(2))
    assert first == again
    assert len({str(start) for start in first}) == 3


def test_scaled_divides_by_the_methods_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("stlbench.simulation.gymnasium.env.load_task", lambda name: pair())
    rewards = []
    for scaled in (False, True):
        env = parallel_env("pair", "raw", scaled=scaled)
        env.reset(options={"state": [-0.5, 0.5]})
        rewards.append(env.step(moves(2, 3))[1]["left"])
    assert env.method.scale == pytest.approx(5)  # .6 - abs(a - 1) lies in [-4.4, .6]
    assert rewards[1] == pytest.approx(rewards[0] / env.method.scale)


def test_what_a_robot_is_given_is_its_own_to_change(two: StlParallelEnv) -> None:
    seen, infos = two.reset(seed=0)
    kept = seen["right"].copy(), infos["right"]["signals"].copy()
    seen["left"][:] = 9
    infos["left"]["signals"][:] = 9
    infos["left"]["t"] = 9
    np.testing.assert_array_equal(seen["right"], kept[0])
    np.testing.assert_array_equal(infos["right"]["signals"], kept[1])
    assert infos["right"]["t"] == 0


def test_continuous_actions(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = {"v": {"low": -1, "high": 1}, "w": {"low": -2, "high": 2}, "u": {"low": 0, "high": 3}}
    task = pair(actions=axes, robots={"left": ["v"], "right": ["w", "u"]})
    monkeypatch.setattr("stlbench.simulation.gymnasium.env.load_task", lambda name: task)
    monkeypatch.setattr(type(task.system), "step", lambda self, state, action: action[:, :2] + action[:, 2:])
    env = parallel_env("pair", "raw")
    assert env.action_space("left") == Box(-1, 1, (1,), np.float32)
    assert env.action_space("right") == Box(np.array([-2, 0], np.float32), np.array([2, 3], np.float32))
    env.reset()
    _, _, _, _, infos = env.step({"right": np.array([1.5, 2], np.float32), "left": np.array([-0.5], np.float32)})
    assert infos["left"]["signals"].tolist() == [[1.5, 3.5]]


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        ({"left": 1}, "an action is needed of each of left, right, got left"),
        (moves(1, 1) | {"up": 1}, "an action is needed of each of left, right, got left, right, up"),
        (moves(3, 1), r"an action of left is in Discrete\(3\), got .*3"),
        (moves(2, 1) | {"right": 1.5}, r"an action of right is in Discrete\(5\), got 1.5"),
    ],
)
def test_actions_that_are_none(two: StlParallelEnv, actions: dict[str, Any], message: str) -> None:
    with pytest.raises(ResetNeeded):
        two.step(actions)
    two.reset()
    with pytest.raises(InvalidAction, match=message):
        two.step(actions)


def test_a_task_of_one_robot() -> None:
    with pytest.raises(UsageError, match=r"^task hold-disc has one robot; .* under 'robots' in its file$"):
        parallel_env("hold-disc", "funnel")


def test_without_pettingzoo_it_is_one_clear_line() -> None:
    program = "import sys; sys.modules['pettingzoo'] = None\nimport stlbench.parallel"
    ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    last = ran.stderr.strip().splitlines()[-1]
    said = 'stlbench.errors.UsageError: stlbench.parallel needs the extra multi: pip install "stlbench-rl[multi]"'
    assert last.startswith(said)


def test_the_robots_of_a_grid() -> None:
    """Each robot's own grid, and the joint index whose vector theirs make: the last robot's index runs fastest."""
    grid = ActionGrid(("u", "v", "w"), ((0.0, 1.0), (0.0, 2.0, 4.0), (5.0, 6.0)), (1, 2))
    first, second = grid.parts
    assert (first.names, second.names) == (("u",), ("v", "w"))
    assert (first.robots, second.robots) == ((), ())
    joint = np.ravel_multi_index((1, 4), (first.size, second.size))
    assert joint == 10
    assert grid.vectors[joint].tolist() == [*first.vectors[1], *second.vectors[4]] == [1, 4, 5]
    assert ActionGrid(grid.names, grid.axes).parts == (ActionGrid(grid.names, grid.axes),)


def test_a_pickle_is_made_again_the_same() -> None:
    env = parallel_env("formation", "funnel")
    copy = pickle.loads(pickle.dumps(env))
    one, other = (each.reset(seed=3)[0] for each in (env, copy))
    assert [*one] == [*other]
    assert all((one[robot] == other[robot]).all() for robot in one)


def test_whole_numbers_are_actions_where_actions_are_continuous(monkeypatch: pytest.MonkeyPatch) -> None:
    axes = {"v": {"low": -1, "high": 1}, "w": {"low": -2, "high": 2}}
    monkeypatch.setattr("stlbench.simulation.gymnasium.env.load_task", lambda name: pair(actions=axes))
    env = parallel_env("pair", "raw")
    env.reset(options={"state": [0, 0]})
    samples = env.step({"left": np.array([1], np.int8), "right": np.array([-2], np.int8)})[4]["left"]["signals"]
    assert samples.tolist() == [[0.5, -1]]
