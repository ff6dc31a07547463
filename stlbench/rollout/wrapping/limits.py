"""How many steps an episode of an environment has."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.wrappers import TimeLimit

from stlbench.errors import UsageError


def steps_of(env: gymnasium.Env[Any, Any], steps: int | None) -> int:
    """Those that were asked for, else the time limit. Raises `UsageError`: neither, or more than the limit."""
    limit = _wrapped_limit(env)
    if steps is None:
        return _known(limit or _registered(env))
    return _within(steps, limit)


def steps_of_copies(envs: VectorEnv[Any, Any, Any], steps: int | None, mode: AutoresetMode) -> int:
    """The same for a vector environment, which restarts at its own time limit and at no other step."""
    inside = envs.unwrapped
    limit = (_wrapped_limit(inside.envs[0]) if isinstance(inside, SyncVectorEnv) else None) or _registered(envs)
    if steps is None:
        return _known(limit)
    if limit is not None and mode is not AutoresetMode.DISABLED and steps != limit:
        raise UsageError(f"steps = {steps}, but the vector environment restarts after {limit}; make it with that limit")
    return _within(steps, limit)


def _known(limit: int | None) -> int:
    if limit is None:
        raise UsageError("steps: the environment says no time limit; give the length of an episode, steps=200")
    return limit


def _within(steps: int, limit: int | None) -> int:
    if isinstance(steps, bool) or not isinstance(steps, int | np.integer) or steps < 1:
        raise UsageError(f"steps is a whole number, at least 1, got {steps!r}")
    if limit is not None and steps > limit:
        raise UsageError(f"steps = {steps}, but the environment ends an episode after {limit}")
    return int(steps)


def _wrapped_limit(env: gymnasium.Env[Any, Any]) -> int | None:
    """The least limit that a wrapper sets."""
    limits = []
    while isinstance(env, gymnasium.Wrapper):
        if isinstance(env, TimeLimit):
            limits.append(int(env._max_episode_steps))
        env = env.env
    return min(limits, default=None)


def _registered(env: Any) -> int | None:
    """The limit that the environment is registered with, or that `gymnasium.make_vec` was given in its place."""
    if env.spec is None:
        return None
    limit: int | None = env.spec.kwargs.get("max_episode_steps", env.spec.max_episode_steps)
    return limit
