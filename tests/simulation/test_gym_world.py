"""The world of an environment: signals and features by hand, seeds, ends, and what is refused at a step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Discrete, MultiDiscrete
from helpers.walk_env import Walk
from helpers.walk_task import Made, WalkTask, walk

from stlbench.contract import Array, GymTask, World
from stlbench.errors import UsageError
from stlbench.simulation.environment import Simulator
from stlbench.simulation.worlds import make_world
from stlbench.task.task import Task
from stlbench_methods.raw import Raw

NOISY = WalkTask(noise=1.0)


def begun(task: Task, *seeds: int) -> World:
    world = make_world(task, len(seeds))
    world.restart(np.arange(len(seeds)), np.array(seeds, dtype=float)[:, None])
    return world


def act(*actions: float) -> Array:
    return np.array(actions, dtype=float)[:, None]


def test_samples_by_hand() -> None:
    world = begun(walk(), 0, 0)
    assert world.signals.tolist() == [[0], [0]]
    samples = world.advance(act(2, 0), 3)
    assert samples[..., 0].tolist() == [[0, 0], [0.5, -0.5], [1, -1], [1.5, -1.5]]
    assert world.signals.tolist() == [[1.5], [-1.5]]
    assert world.lived.tolist() == [3, 3]
    assert not world.ended.any()


def test_features_are_all_of_the_observation_between_its_ends_or_over_its_scale() -> None:
    world = begun(walk(), 0)
    world.advance(act(2), 4)
    assert world.features(np.array([4])).tolist() == [[2 / 50, -2 / 50]]
    scaled = begun(walk(environment={"id": "unused", "names": ["x", "minus"], "scale": {"x": 4}}), 0)
    scaled.advance(act(2), 4)
    assert scaled.features(np.array([4])).tolist() == [[0.5, -2 / 50]]


@pytest.mark.parametrize(
    ("kind", "names", "signals", "expected"),
    [
        (WalkTask(), ["x", "minus"], {"x": "x", "y": "2 * minus - 1"}, [1, -3]),
        (WalkTask(), None, {"x": "doubled / 4"}, [0.5]),
        (WalkTask(kind="dict"), {"mirror": ["m"]}, {"x": "-m", "y": "doubled + m"}, [1, 1]),
        (WalkTask(kind="dict"), {"place": ["x", "minus"], "mirror": ["m"]}, {"x": "x + minus + m"}, [-1]),
        (WalkTask(kind="picture"), None, {"x": "doubled"}, [2]),
    ],
)
def test_signals_are_expressions_over_entries_and_info(
    kind: GymTask, names: Any, signals: dict[str, str], expected: list[float]
) -> None:
    declared = {name: {"low": -10, "high": 10, "expression": text} for name, text in signals.items()}
    task = walk(kind, signals=declared, environment={"id": "unused"} | ({"names": names} if names else {}))
    world = begun(task, 0)
    world.advance(act(2), 2)  # x is 1
    assert world.signals.tolist() == [expected]


def test_signals_may_be_a_function() -> None:
    class Written(WalkTask):
        def signals(self, observation: Any, info: Mapping[str, Any]) -> Sequence[float]:
            return (10 * observation[0] + info["doubled"],)

    world = begun(walk(Written()), 0)
    world.advance(act(2), 1)
    assert world.signals.tolist() == [[6.0]]


def test_a_seed_and_the_actions_are_an_episode_whatever_the_copy_did_before() -> None:
    generator = np.random.default_rng(0)
    actions = generator.integers(3, size=(8, 3, 1)).astype(float)

    def episode(world: World, columns: list[int]) -> Array:
        return np.stack([world.advance(action[columns], 1)[1] for action in actions])

    world = begun(walk(NOISY), 5, 6, 7)
    first = episode(world, [0, 1, 2])
    assert len(set(first[0, :, 0])) == 3
    world.restart(np.arange(3), np.array([[7.0], [6.0], [5.0]]))
    swapped = episode(world, [2, 1, 0])
    assert np.array_equal(swapped, first[:, ::-1])
    assert np.array_equal(episode(begun(walk(NOISY), 6), [1]), first[:, [1]])


def test_rows_that_begin_anew_leave_the_others_alone() -> None:
    world = begun(walk(), 0, 0, 0)
    world.advance(act(2, 2, 2), 2)
    world.restart(np.array([1]), np.array([[3.0]]))
    assert world.signals.tolist() == [[1], [0], [1]]
    assert world.lived.tolist() == [2, 0, 2]
    assert world.features(np.zeros(3, dtype=np.int64))[:, 0].tolist() == [1 / 50, 0, 1 / 50]


def test_a_copy_that_has_ended_stands_still_and_is_not_stepped() -> None:
    world = begun(walk(WalkTask(wall=1.0)), 0, 0)
    samples = world.advance(act(2, 0), 4)
    assert samples[:, 0, 0].tolist() == [0, 0.5, 1, 1, 1]
    assert (world.ended.tolist(), world.lived.tolist()) == ([True, False], [2, 4])
    assert world.advance(act(0, 1), 2)[:, 0, 0].tolist() == [1, 1, 1]
    world.restart(np.array([0]), np.array([[0.0]]))
    assert (world.ended.tolist(), world.lived.tolist(), world.signals[0, 0]) == ([False, False], [0, 6], 0)


def test_copies_are_used_again() -> None:
    made = list[int]()

    task = walk(Made(lambda: made.append(1) or Walk()))  # type: ignore[func-returns-value]
    for _ in range(3):
        begun(task, 0, 1, 2)
    assert len(made) == 3


class Odd(Walk):
    """Does what an environment must not do, from its third step on."""

    def __init__(self, fault: str) -> None:
        super().__init__()
        self.fault, self.count = fault, 0

    def step(self, action: Any) -> Any:
        observation, reward, terminated, truncated, info = super().step(action)
        self.count += 1
        if self.count > 2:
            faults = {"nan": np.array([np.nan, 0]), "longer": np.zeros(3), "shorter": np.zeros(1)}
            faults["text"] = np.array(["a", "b"])
            observation = faults.get(self.fault, observation)
            if self.fault == "old gym":
                return observation, reward, terminated, info
            info = {} if self.fault == "no info" else {"doubled": "much"} if self.fault == "no number" else info
        return observation, reward, terminated, truncated, info


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("longer", "the environment returned an observation outside its space: 3 numbers in place of 2"),
        ("shorter", "the environment returned an observation outside its space: 1 numbers in place of 2"),
        ("text", "the environment returned an observation outside its space: "),
        ("no info", "signals: no 'doubled': the observation has x, minus, the info nothing"),
        ("old gym", r"the environment's step returns observation, reward, terminated, truncated, info, got \(array"),
        ("no number", "signals: 'doubled' of the info is no number, but 'much'"),
    ],
)
def test_what_an_environment_must_not_do_is_said_in_a_line(fault: str, said: str) -> None:
    texts = {"x": "x", "y": "doubled"}
    signals = {name: {"low": -9, "high": 9, "expression": texts[name]} for name in texts}
    world = begun(walk(Made(lambda: Odd(fault)), signals=signals), 0)
    world.advance(act(2), 2)
    with pytest.raises(UsageError, match=f"^{said}[^\n]*$"):
        world.advance(act(2), 1)


@pytest.mark.parametrize(
    ("signal", "said"),
    [
        ("x", "task walk: signal x is nan at step 3 in 1 of 1 copies"),
        ("minus", "task walk: feature 0 is nan at step 3 in 1 of 1 copies"),  # the policy sees x all the same
    ],
)
def test_an_observation_that_is_none_is_told_where_all_such_things_are(signal: str, said: str) -> None:
    task = walk(Made(lambda: Odd("nan")), signals={"x": {"low": -9, "high": 9, "expression": signal}})
    simulator = Simulator(task, Raw(task.specification))
    simulator.reset(np.zeros((1, 1)))
    for _ in range(2):
        simulator.advance(np.array([2]))
        simulator.observe()
    with pytest.raises(UsageError, match=f"^{said}$"):
        _ = simulator.advance(np.array([2])), simulator.observe()


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("actions", r"the environment changed its action space, from Discrete\(3\) to Discrete\(5\)"),
        ("no tuple", r"the environment's reset returns an observation and an info, got \[0\. 0\.\]"),
    ],
)
def test_what_an_environment_must_not_do_when_it_begins_anew(fault: str, said: str) -> None:
    class Changing(Walk):
        begun = 0

        def reset(self, **options: Any) -> Any:
            self.begun += 1
            if self.begun == 2 and fault == "actions":
                self.action_space = Discrete(5)
            begun_ = super().reset(**options)
            return np.zeros(2) if self.begun == 2 and fault == "no tuple" else begun_

    world = begun(walk(Made(Changing)), 0)
    with pytest.raises(UsageError, match=f"^{said}$"):
        world.restart(np.array([0]), np.zeros((1, 1)))


class Taking(Walk):
    """Remembers what it was given."""

    def __init__(self, space: Any) -> None:
        super().__init__()
        self.action_space, self.given = space, list[Any]()

    def step(self, action: Any) -> Any:
        self.given.append(action)
        return super().step(1)


@pytest.mark.parametrize(
    ("space", "vector", "given"),
    [
        (Box(-1, 1, (2, 2), np.float32), [0.5, -0.5, 1, 0], np.array([[0.5, -0.5], [1, 0]], np.float32)),
        (MultiDiscrete([2, 3]), [1, 2], np.array([1, 2])),
        (gymnasium.spaces.Discrete(3, start=5), [6], np.int64(6)),
    ],
)
def test_actions_are_what_the_environment_takes(space: Any, vector: list[float], given: Any) -> None:
    env = Taking(space)
    task = walk(Made(lambda: env))
    world = begun(task, 0)
    world.advance(np.array([vector]), 1)
    assert np.array_equal(env.given[0], given)
    assert space.contains(env.given[0])
    low = space.low if isinstance(space, Box) else space.start
    assert (len(task.actions.names), task.actions.low[0]) == (len(vector), float(np.ravel(given * 0 + low)[0]))
