"""A wrapped vector environment is a vector of wrapped environments, entry by entry, masks and dtypes included."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit
from helpers.walk_env import RIGHT, STAY, Walk

import stlbench
from stlbench.errors import UsageError

MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]
OPTIONS: dict[str, Any] = {"ranges": {"x": (-10, 10)}, "method": "flag"}
FORMULA = "F[0,3] G[0,4] x >= 0.5"


def make(kind: str = "vector") -> gymnasium.Env[Any, Any]:
    return TimeLimit(Walk(wall=1.0, noise=0.3, kind=kind), 7)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("terminated", ["hold", "violated", "interval"])
@pytest.mark.parametrize(
    ("kind", "reading"),
    [
        ("vector", {"names": ("x", "minus")}),
        ("dict", {"signals": lambda observation, info: {"x": info["doubled"] - observation["place"][0]}}),
        ("picture", {"signals": {"x": "doubled / 2"}}),
    ],
)
def test_it_is_a_vector_of_wrapped_environments(
    mode: AutoresetMode, terminated: str, kind: str, reading: dict[str, Any]
) -> None:
    options = OPTIONS | reading | {"terminated": terminated}
    plain = SyncVectorEnv([lambda: make(kind)] * 3, autoreset_mode=mode)
    ours = stlbench.wrap(plain, FORMULA, **options)
    theirs = SyncVectorEnv([lambda: stlbench.wrap(make(kind), FORMULA, **options)] * 3, autoreset_mode=mode)
    assert ours.observation_space == theirs.observation_space
    assert data_equivalence(ours.reset(seed=5), theirs.reset(seed=5))
    generator, ends = np.random.default_rng(0), 0
    for _ in range(40):
        actions = generator.integers(3, size=3)
        step, expected = ours.step(actions), theirs.step(actions)
        assert data_equivalence(step, expected), (step, expected)
        ends += int((step[2] | step[3]).sum())
    assert ends > 6


def test_without_autoreset_a_mask_says_who_restarts() -> None:
    plain = SyncVectorEnv([lambda: Walk(wall=1.0)] * 2, autoreset_mode=AutoresetMode.DISABLED)
    envs = stlbench.wrap(plain, "G[0,3] x <= 0.5", names=("x", "minus"), ranges={"x": (-10, 10)}, method="raw", steps=3)
    envs.reset(seed=0, options={"x": 0.0})
    envs.step(np.array([RIGHT, STAY]))
    observations, rewards, terminated, truncated, infos = envs.step(np.array([RIGHT, STAY]))
    assert (rewards.tolist(), terminated.tolist(), truncated.tolist()) == ([-1.0, 0.5], [True, False], [False, False])
    assert (infos["robustness"].tolist(), infos["satisfied"].tolist()) == ([-0.5, -np.inf], [False, False])
    with pytest.raises(ResetNeeded):
        envs.step(np.array([RIGHT, STAY]))
    _, infos = envs.reset(options={"reset_mask": np.array([True, False]), "x": 0.0})
    assert (infos["t"].tolist(), infos["_t"].tolist()) == ([0, 2], [True, False]) or infos["t"].tolist() == [0, 0]
    observations, rewards, terminated, truncated, infos = envs.step(np.array([STAY, STAY]))
    assert (infos["t"].tolist(), truncated.tolist()) == ([1, 3], [False, True])
    assert infos["satisfied"].tolist() == [False, True]
    assert observations[:, -1].tolist() == pytest.approx([-1 / 3, 1.0])


@pytest.mark.parametrize("mode", ["sync", "vector_entry_point"])
def test_a_vector_environment_of_gymnasiums_own(mode: str) -> None:
    """Of those that keep the pole upright the episode is complete; the others fall."""
    options: dict[str, Any] = {"names": ("x", "v", "angle", "w"), "ranges": {"angle": (-0.42, 0.42)}, "method": "raw"}
    made = gymnasium.make_vec("CartPole-v1", 4, vectorization_mode=mode, max_episode_steps=30)
    envs = stlbench.wrap(made, "G abs(angle) <= 0.2", **options)
    assert envs.specification.steps == 30
    (observations, _), upright = envs.reset(seed=0), np.array([True, True, False, False])
    ends = list[Any]()
    for _ in range(31):
        actions = np.where(upright, observations[:, 2] + 0.3 * observations[:, 3] > 0, 1)
        observations, _, terminated, truncated, infos = envs.step(actions.astype(np.int64))
        assert observations in envs.observation_space
        rows = np.flatnonzero(terminated | truncated)
        ends += [(bool(upright[i]), bool(truncated[i]), bool(infos["satisfied"][i])) for i in rows]
    assert set(ends) == {(True, True, True), (False, False, False)}
    assert len(ends) >= 6


def test_a_vector_environment_that_restarts_late_or_does_not_say_when() -> None:
    endless = SyncVectorEnv([lambda: Walk()] * 2)
    envs = stlbench.wrap(endless, FORMULA, names=("x", "minus"), steps=7, **OPTIONS)
    envs.reset(seed=0)
    for _ in range(6):
        envs.step(np.array([STAY, STAY]))
    with pytest.raises(UsageError, match="copy 0 goes on after step 7; steps should be its time limit"):
        envs.step(np.array([STAY, STAY]))
    del endless.metadata["autoreset_mode"]
    with pytest.raises(UsageError, match="does not say when it restarts"):
        stlbench.wrap(endless, FORMULA, names=("x", "minus"), steps=7, **OPTIONS)


def test_a_message_names_the_copy() -> None:
    class Breaks(Walk):
        def _observe(self) -> Any:
            return super()._observe() * (np.nan if self.x >= 1 else 1)

    envs = stlbench.wrap(SyncVectorEnv([Breaks] * 2), FORMULA, names=("x", "minus"), steps=7, **OPTIONS)
    envs.reset(seed=0)
    envs.step(np.array([STAY, RIGHT]))
    with pytest.raises(UsageError, match="signals: x is nan at step 2 of copy 1"):
        envs.step(np.array([STAY, RIGHT]))
