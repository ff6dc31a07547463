"""What `stlbench.wrap` says of environments that break a rule of Gymnasium, and of rewards in a form of their own."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit
from helpers.walk_env import BASE, RIGHT, STAY, Walk, played, wrapped
from helpers.walk_task import Made, walk

import stlbench
from stlbench.errors import UsageError
from stlbench.simulation.worlds import make_world
from stlbench.task.gym_make import JointEnv

FORMULA = "G[0,4] x <= 1"

# ----------------------------------------------------------------------------------------------------------- old gym


class Resets(Walk):
    """Its reset is that of the older gym, which returns the observation alone."""

    def reset(self, **options: Any) -> Any:
        return super().reset(**options)[0]


class Takes(Walk):
    """Its reset takes no seed."""

    def reset(self) -> Any:  # type: ignore[override]
        return super().reset()[0]


class Steps(Walk):
    """Its step returns four values."""

    def step(self, action: Any) -> Any:
        observation, reward, done, _, info = super().step(action)
        return observation, reward, done, info


RESET, SEEDED, STEP = (
    "^the environment's reset returns an observation and an info[,;] .*",
    "^the environment's reset takes a seed and options, .*",
    "^the environment's step returns observation, reward, terminated, truncated, info[,;] .*",
)
OLD = [(Resets, RESET), (Takes, SEEDED), (Steps, STEP)]


@pytest.mark.parametrize(("kind", "said"), OLD)
@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.parametrize("vector", [False, True])
def test_an_environment_of_the_older_api_is_told_as_check_tells_it(
    kind: type[Walk], said: str, limited: bool, vector: bool
) -> None:
    """A TimeLimit, or a vector environment, trips over it before the wrapper does."""

    def make() -> gymnasium.Env[Any, Any]:
        return TimeLimit(kind(), 4) if limited else kind()

    env: Any = stlbench.wrap(SyncVectorEnv([make] * 2) if vector else make(), FORMULA, **BASE, steps=4)  # type: ignore[call-overload]
    with pytest.raises(UsageError, match=said):
        _ = env.reset(seed=0), env.step(np.array([STAY, STAY]) if vector else STAY)


@pytest.mark.parametrize(("kind", "said"), OLD)
def test_so_is_one_of_a_task(kind: type[Walk], said: str) -> None:
    world = make_world(walk(Made(kind)), 1)
    with pytest.raises(UsageError, match=said):
        _ = world.restart(np.array([0]), np.zeros((1, 1))), world.advance(np.array([[1.0]]), 1)


def test_so_is_a_parallel_environment() -> None:
    class Parallel:
        possible_agents = agents = ("a",)

        def action_space(self, name: str) -> Box:
            return Box(-1, 1, (1,))

        observation_space = action_space

        def reset(self, seed: Any = None, options: Any = None) -> Any:
            return {"a": np.zeros(1)}

        def step(self, actions: Any) -> Any:
            return {"a": np.zeros(1)}, {"a": 0.0}, {"a": False}, {}

    joint = JointEnv(Parallel())
    with pytest.raises(UsageError, match=RESET):
        joint.reset()
    with pytest.raises(UsageError, match=STEP):
        joint.step(np.zeros(1))


def test_an_error_of_the_environments_own_stays_what_it_is() -> None:
    class Fails(Walk):
        def step(self, action: Any) -> Any:
            first, second = [action]  # type: ignore[misc]
            return first, second

    with pytest.raises(ValueError, match=r"^not enough values to unpack") as caught:
        played(wrapped(Fails()), STAY)
    assert not isinstance(caught.value, UsageError)


# ------------------------------------------------------------------------------------------ the environment's reward


@pytest.mark.parametrize(
    ("own", "shown"),
    [(np.array([3.0]), 3.0), (np.float32(2), 2.0), (np.array([1.0, 2.0]), np.nan), (None, np.nan), ("much", np.nan)],
)
def test_a_reward_of_any_form_is_accepted_as_a_task_does(own: Any, shown: float) -> None:
    """Nothing is paid by it. The info has it where it is one number."""

    class Pays(Walk):
        def step(self, action: Any) -> Any:
            observation, _, *rest = super().step(action)
            return observation, own, *rest

    ((_, reward, _, _, info),) = played(wrapped(Pays()), RIGHT)
    assert (reward, info["env_reward"].dtype, info["env_reward"].shape) == (0.5, np.float64, ())
    np.testing.assert_array_equal(info["env_reward"], shown)
    world = make_world(walk(Made(Pays)), 1)
    world.restart(np.array([0]), np.zeros((1, 1)))
    assert world.advance(np.array([[2.0]]), 1)[1].tolist() == [[0.5]]


@pytest.mark.parametrize(("width", "shown"), [(1, [7.0, 7.0]), (2, [np.nan, np.nan])])
def test_so_is_that_of_a_vector_environment(width: int, shown: list[float]) -> None:
    class Wide(SyncVectorEnv):
        def step(self, actions: Any) -> Any:
            observations, rewards, *rest = super().step(actions)
            return observations, np.tile(rewards[:, None], width), *rest

    envs = stlbench.wrap(Wide([Walk] * 2, autoreset_mode=AutoresetMode.DISABLED), FORMULA, **BASE, steps=4)
    envs.reset(seed=0)
    np.testing.assert_array_equal(envs.step(np.array([STAY, STAY]))[-1]["env_reward"], shown)


def test_a_signal_in_an_array_of_one_number_is_a_number() -> None:
    class Boxed(Walk):
        def step(self, action: Any) -> Any:
            *rest, info = super().step(action)
            return *rest, {"doubled": np.array([info["doubled"]])}

    class Written(Made):
        def signals(self, observation: Any, info: Any) -> Any:
            return (np.ravel(info["doubled"]) / 2,)

    for signals in ({"x": "doubled / 2"}, lambda observation, info: {"x": observation[:1]}):
        *_, info = played(wrapped(Boxed(), signals=signals), RIGHT)[0]
        assert info["signals"].tolist() == [[0.5]]
    world = make_world(walk(Written(Boxed)), 1)
    world.restart(np.array([0]), np.zeros((1, 1)))
    assert world.advance(np.array([[2.0]]), 1)[1].tolist() == [[0.5]]


# ------------------------------------------------------------------------------- outside of the observation space


class Far(Walk):
    """Says that x is in [-1, 1], and -x too."""

    def __init__(self, kind: str = "vector") -> None:
        super().__init__(kind=kind)
        line = Box(np.array([-1, -9], np.float32), np.array([1, 9], np.float32))
        self.observation_space = Dict({"place": line}) if kind == "dict" else line

    def _observe(self) -> Any:
        seen = super()._observe()
        return {"place": seen["place"]} if self.kind == "dict" else seen


SAID = "returned an observation outside its space at step 3{}: {} is 1.5, outside -1 to 1; a `scale` for"


def told(play: Callable[[], Any]) -> list[str]:
    with pytest.warns(UserWarning) as caught:  # noqa: PT030 - the text is compared below
        play()
    return [str(each.message) for each in caught]


@pytest.mark.parametrize(
    ("kind", "options", "name"),
    [
        ("vector", {}, "'x'"),
        ("vector", {"names": None, "signals": {"x": "doubled / 2"}}, "number 0 of the observation"),
        ("dict", {"names": {"place": ("x", "minus")}}, "'x'"),
    ],
)
def test_an_observation_outside_its_space_is_a_warning_once(kind: str, options: dict[str, Any], name: str) -> None:
    (line,) = told(lambda: played(wrapped(Far(kind), **options), *[RIGHT] * 4))
    assert SAID.format("", name) in line
    assert line.endswith("`ranges` should reach what signals take\x1b[0m")


def test_of_a_vector_environment_the_copy_is_named() -> None:
    envs = stlbench.wrap(SyncVectorEnv([Far] * 2), FORMULA, **BASE, steps=4)
    envs.reset(seed=0)
    (line,) = told(lambda: [envs.step(np.array([STAY, RIGHT])) for _ in range(3)])
    assert SAID.format(" of copy 1", "'x'") in line


def test_a_scale_takes_the_place_of_the_ends_and_a_last_bit_is_none(recwarn: pytest.WarningsRecorder) -> None:
    played(wrapped(Far(), scale={"x": 2}), *[RIGHT] * 4)
    played(wrapped(Far()), STAY, STAY, x=1 + 1e-7)
    assert not recwarn.list
    assert len(told(lambda: played(wrapped(Far()), STAY, x=1 + 1e-5))) == 1


# ---------------------------------------------------------------------------------------------------------- hindsight


class Reach(gymnasium.Env[Any, Any]):
    """A point on a line with a goal, as the Fetch environments have it: the reward is computed from the goal."""

    def __init__(self) -> None:
        part = Box(-9.0, 9.0, (1,), np.float32)
        self.observation_space = Dict(dict.fromkeys(("observation", "achieved_goal", "desired_goal"), part))
        self.action_space = Box(-1.0, 1.0, (1,), np.float32)

    def reset(self, *, seed: int | None = None, options: Any = None) -> Any:
        super().reset(seed=seed)
        self.x = np.zeros(1, np.float32)
        return self._observe(), {}

    def step(self, action: Any) -> Any:
        self.x = self.x + 0.1 * action
        seen = self._observe()
        reward = self.compute_reward(seen["achieved_goal"], seen["desired_goal"], {})
        return seen, float(reward), False, False, {}

    def compute_reward(self, achieved: Any, desired: Any, info: Any) -> Any:
        return -np.linalg.norm(achieved - desired, axis=-1)

    def _observe(self) -> Any:
        return {"observation": self.x, "achieved_goal": self.x, "desired_goal": np.ones(1, np.float32)}


def test_hindsight_would_pay_the_environments_reward_and_is_refused() -> None:
    from stable_baselines3 import SAC
    from stable_baselines3.common.monitor import Monitor
    from stable_baselines3.her import HerReplayBuffer

    def learn(**options: Any) -> SAC:
        names: dict[str, Any] = {"names": {"achieved_goal": ["x"]}, "ranges": {"x": (-1, 1)}}
        env = stlbench.wrap(TimeLimit(Reach(), 5), "F x >= 0.3", **names, method="raw")
        small: dict[str, Any] = {"policy_kwargs": {"net_arch": [4]}, "learning_starts": 10, "batch_size": 8, "seed": 0}
        return SAC("MultiInputPolicy", Monitor(env), **small, **options).learn(14)

    assert "robustness" in learn().env.envs[0].step(np.zeros(1, np.float32))[-1]  # type: ignore[union-attr]
    with pytest.raises(
        UsageError, match=r"^compute_reward: the method pays whole .*: leave out `replay_buffer_class`$"
    ):
        learn(replay_buffer_class=HerReplayBuffer)
