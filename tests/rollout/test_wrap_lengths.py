"""How long an episode is."""

from __future__ import annotations

from typing import Any

import gymnasium
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from gymnasium.wrappers import TimeLimit
from helpers.walk_env import Walk

from stlbench.errors import UsageError
from stlbench.rollout.gymnasium.wrap import steps_of, steps_of_copies


@pytest.mark.parametrize(
    ("make", "steps", "expected"),
    [
        (lambda: gymnasium.make("CartPole-v1"), None, 500),
        (lambda: gymnasium.make("CartPole-v1", max_episode_steps=30), None, 30),
        (lambda: gymnasium.make("CartPole-v1"), 20, 20),
        (lambda: TimeLimit(TimeLimit(Walk(), 9), 5), None, 5),
        (Walk, 70, 70),
        (lambda: TimeLimit(Walk(), 5), 6, "steps = 6, but the environment ends an episode after 5"),
        (Walk, None, "the environment says no time limit"),
        (Walk, True, "steps is a whole number, at least 1, got True"),
        (Walk, 2.0, "steps is a whole number, at least 1, got 2.0"),
    ],
)
def test_of_one_environment(make: Any, steps: Any, expected: Any) -> None:
    if isinstance(expected, int):
        assert steps_of(make(), steps) == expected
        return
    with pytest.raises(UsageError, match=expected):
        steps_of(make(), steps)


def test_of_copies_that_do_not_restart_it_may_be_shorter() -> None:
    envs = SyncVectorEnv([lambda: TimeLimit(Walk(), 9)])
    assert steps_of_copies(envs, 5, AutoresetMode.DISABLED) == 5
    with pytest.raises(UsageError, match="restarts after 9; make it with that limit"):
        steps_of_copies(envs, 5, AutoresetMode.NEXT_STEP)
    with pytest.raises(UsageError, match="ends an episode after 9"):
        steps_of_copies(envs, 10, AutoresetMode.DISABLED)


def test_of_copies_made_with_another_limit() -> None:
    for mode in ("sync", "vector_entry_point"):
        envs = gymnasium.make_vec("CartPole-v1", 2, vectorization_mode=mode, max_episode_steps=30)
        assert steps_of_copies(envs, None, AutoresetMode.NEXT_STEP) == 30
