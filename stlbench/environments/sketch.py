"""The first draft of a task file for an environment: what can be known without knowing what is wanted of it."""

from __future__ import annotations

from math import prod
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, Space

from stlbench.environments.making import Gym, made
from stlbench.errors import UsageError

__all__ = ["sketch"]

_STEPS, _SECONDS, _REACH = 200, 0.05, 10.0
"""Where the environment says nothing: steps of an episode, seconds of a step, the largest magnitude of an entry."""


def sketch(identifier: str) -> dict[str, Any]:
    """The content of a `task.yaml` on an environment, with a formula that is there to be changed.

    Args:
        identifier: as `gymnasium.make` takes it.

    Raises:
        UsageError: it cannot be made, or its observation is no array of numbers, nor a Dict of some.
    """
    env = made(identifier, {})
    names, ends = _entries(env.observation_space)
    first, (low, high) = next(iter(ends.items()))
    steps, middle = _limit(identifier), (low + high) / 2
    distance = f"abs({first} - {middle:g})" if middle else f"abs({first})"
    return {
        "title": f"A task on {identifier}",
        "source": identifier,
        "environment": {"id": identifier, "names": names},
        "formula": f"G[0,{steps}] {distance} <= {(high - low) / 4:g}",
        "sampling_time": round(_seconds(env), 6),
        "steps": steps,
        "signals": {name: {"low": low, "high": high} for name, (low, high) in ends.items()},
        "agents": {"dqn" if isinstance(env.action_space, Discrete) else "td3": {}},
        "budgets": {
            "smoke": {"steps": 16 * steps, "seeds": 1, "deadline": 300, "checkpoints": 2, "random_starts": 20},
            "quick": {"steps": 100_000, "seeds": 3, "deadline": 900, "random_starts": 100},
        },
    }


def _entries(space: Space[Any]) -> tuple[Any, dict[str, tuple[float, float]]]:
    """Names as a task file has them, and name -> ends."""
    if isinstance(space, Dict):
        parts = {key: part for key, part in space.spaces.items() if isinstance(part, Box)}
        named = {key: _numbered(key, part) for key, part in parts.items()}
        ends = {name: pair for key, part in parts.items() for name, pair in zip(named[key], _ends(part), strict=True)}
        names: Any = named
    elif isinstance(space, Box):
        names = _numbered("o", space)
        ends = dict(zip(names, _ends(space), strict=True))
    else:
        ends, names = {}, None
    if not ends:
        raise UsageError(f"its observation is no Box, nor a Dict with one: {space}; write the task file by hand")
    return names, ends


def _numbered(name: str, space: Box) -> list[str]:
    """`o0`, `o1`, ..., or the name itself where there is one entry."""
    count, plain = prod(space.shape), "".join(each if each.isalnum() else "_" for each in name)
    return [plain] if count == 1 else [f"{plain}{i}" for i in range(count)]


def _ends(space: Box) -> list[tuple[float, float]]:
    pairs = zip(space.low.ravel().tolist(), space.high.ravel().tolist(), strict=True)
    return [
        (float(f"{low:.4g}"), float(f"{high:.4g}")) if -1e4 < low < high < 1e4 else (-_REACH, _REACH)
        for low, high in pairs
    ]


def _limit(identifier: str) -> int:
    return gymnasium.spec(identifier.rpartition(":")[2]).max_episode_steps or _STEPS


def _seconds(env: Gym) -> float:
    """The environment's own, else by the rate at which it is drawn."""
    own = getattr(env.unwrapped, "dt", None)
    if isinstance(own, float | np.floating):
        return float(own)
    return 1 / env.metadata["render_fps"] if env.metadata.get("render_fps") else _SECONDS
