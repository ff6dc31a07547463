"""Steps of MuJoCo's robots without their rewards: the bits of Gymnasium's own steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import gymnasium
import numpy as np
import pytest

from stlbench.contract import Array, GymTask, World
from stlbench.registry.choices import Choice
from stlbench.simulation import gym_world
from stlbench.simulation.gym_world import is_robot, robot_step
from stlbench.simulation.worlds import make_world
from stlbench.task.file import TaskFile
from stlbench.task.gym_make import Gym, made
from stlbench.task.task import Task

mujoco = pytest.importorskip("mujoco", reason="the extra mujoco is not installed")

ENDING = {"Ant-v5", "Hopper-v5", "Humanoid-v5", "Walker2d-v5"}
"""Those that terminate."""
ROBOTS = sorted(ENDING | {"HalfCheetah-v5", "HumanoidStandup-v5", "Pusher-v5", "Reacher-v5", "Swimmer-v5"})
KEYWORDS: list[tuple[str, dict[str, Any]]] = [
    *((name, {}) for name in ROBOTS),
    ("Ant-v5", {"include_cfrc_ext_in_observation": False, "exclude_current_positions_from_observation": False}),
    ("Ant-v5", {"terminate_when_unhealthy": False, "frame_skip": 3}),
    ("Hopper-v5", {"healthy_angle_range": [-1, 1]}),
]


def plays(space: Any, steps: int) -> Iterator[Array]:
    """Actions (steps, axes) at random, then of the greatest size, then of it for ten steps each."""
    generator, size = np.random.default_rng(0), len(space.low)
    yield generator.uniform(space.low, space.high, (steps, size))
    yield np.where(generator.random((steps, size)) < 0.5, space.low, space.high)
    yield np.repeat(np.where(generator.random((steps // 10, size)) < 0.5, space.low, space.high), 10, axis=0)


def all_of(env: Gym) -> Array:
    """What MuJoCo's next step depends on, with where its solver begins."""
    inner: Any = env.unwrapped
    parts = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(inner.model, parts))
    mujoco.mj_getState(inner.model, inner.data, state, parts)
    return state


@pytest.mark.parametrize(("name", "keywords"), KEYWORDS)
def test_each_step_has_the_bits_of_the_environments_own(name: str, keywords: Mapping[str, Any]) -> None:
    own, ours = made(name, keywords), made(name, keywords)
    assert is_robot(ours)
    episodes = 0
    for actions in plays(own.action_space, 80):
        over = True
        for action in actions.astype(np.float32):
            if over:
                observation, at_reset = own.reset(seed=episodes)
                assert observation.tobytes() == ours.reset(seed=episodes)[0].tobytes()
                episodes += 1
            observation, _, terminated, truncated, info = own.step(action)
            again, over, told = robot_step(ours, action)
            assert told.keys() == at_reset.keys()
            assert observation.tobytes() == again.tobytes()
            assert observation.dtype == again.dtype
            assert (terminated, truncated) == (over, False)
            assert all(np.array(info[key]).tobytes() == np.array(value).tobytes() for key, value in told.items())
            assert all_of(own).tobytes() == all_of(ours).tobytes()
    assert (episodes > 3) == (name in ENDING and "terminate_when_unhealthy" not in keywords)


def task(name: str, kind: GymTask | None = None, signal: str = "x_position", **entry: Any) -> Task:
    """A task on an environment whose info has that entry."""
    file = {
        "title": name,
        "source": name,
        "formula": "F[0,8] (x >= 1)",
        "sampling_time": 0.05,
        "steps": 8,
        "environment": {"id": name} | entry,
        "signals": {"x": {"low": -10, "high": 10, "expression": signal}},
        "budgets": {"smoke": {"steps": 40, "seeds": 1, "deadline": 60, "checkpoints": 1, "random_starts": 0}},
        "agents": {"td3": {}},
    }
    return Task(Choice(name), TaskFile.model_validate(file), kind or GymTask())


def played(name: str, copies: int = 17) -> Iterator[tuple[bytes, bytes, bytes, bytes]]:
    """What a world shows after each of 40 decisions of 2 steps, where copies that ended begin anew."""
    robot_world, generator = make_world(task(name), copies), np.random.default_rng(1)
    begin(robot_world, range(copies))
    size, seed = len(task(name).actions.low), copies
    for _ in range(40):
        samples = robot_world.advance(generator.uniform(-1, 1, (copies, size)), 2)
        features = robot_world.features(np.zeros(copies, dtype=np.int64))
        yield samples.tobytes(), features.tobytes(), robot_world.ended.tobytes(), robot_world.lived.tobytes()
        if len(rows := np.flatnonzero(robot_world.ended)):
            robot_world.restart(rows, np.arange(seed, seed + len(rows), dtype=float)[:, None])
            seed += len(rows)


def begin(robot_world: World, seeds: Sequence[int]) -> None:
    robot_world.restart(np.arange(len(seeds)), np.array(seeds, dtype=float)[:, None])


@pytest.mark.parametrize("name", ["Ant-v5", "HalfCheetah-v5", "Hopper-v5", "Walker2d-v5"])
def test_worlds_of_robots_have_the_bits_of_worlds_by_the_environments_own_steps(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours = list(played(name))
    monkeypatch.setattr(gym_world, "is_robot", lambda env: False)
    assert ours == list(played(name))


class Told(GymTask):
    """Its signal is of the info of a step, and of none at a reset."""

    def signals(self, observation: Any, info: Mapping[str, Any]) -> Sequence[float]:
        return [info.get("reward_ctrl", 1.0)]


class Steered(GymTask):
    """Its controller reads what only a step says."""

    def controller(self, observation: Any, info: Mapping[str, Any], t: int) -> Sequence[float]:
        return [info.get("reward_ctrl", 1.0)] * 6


def test_code_of_a_task_gets_all_of_the_info() -> None:
    action = np.full((1, 6), 0.5)
    told, steered = (make_world(task("HalfCheetah-v5", kind), 1) for kind in (Told(), Steered()))
    begin(told, [0])
    told.advance(action, 1)
    assert told.signals.tolist() == [[pytest.approx(-0.1 * 6 * 0.25)]]
    begin(steered, [0])
    assert steered.by_hand(np.array([0])) == pytest.approx(np.ones((1, 6)))
    steered.advance(action, 1)
    assert steered.by_hand(np.array([1])) == pytest.approx(np.full((1, 6), -0.15))


def test_a_task_with_a_controller_has_the_steps_of_a_robot_until_the_controller_acts() -> None:
    steered = make_world(task("HalfCheetah-v5", Steered()), 1)
    begin(steered, [0])
    steered.advance(np.full((1, 6), 0.5), 1)
    assert steered.by_hand(np.array([1])) == pytest.approx(np.ones((1, 6)))  # nobody has asked it before


class Slower(gymnasium.Wrapper[Any, Any, Any, Any]):
    def step(self, action: Any) -> Any:
        return self.env.step(action / 2)


def test_what_is_changed_is_no_robot() -> None:
    ant = made("Ant-v5", {})
    assert is_robot(ant)
    assert not is_robot(Slower(ant))
    assert not is_robot(ant.unwrapped)
    ant.unwrapped.do_simulation = ant.unwrapped.do_simulation  # type: ignore[attr-defined]
    assert not is_robot(ant)
    derived = made("Ant-v5", {})
    derived.unwrapped.__class__ = type("AntEnv", (type(derived.unwrapped),), {})
    assert not is_robot(derived)
    assert not is_robot(made("InvertedPendulum-v5", {}))
    assert not is_robot(made("CartPole-v1", {}))
