"""Specifications in one line, and a method run along given traces, for the tests in this folder."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from helpers.stepwise import one_step
from stlbench import stl
from stlbench.contract import Array, RewardMethod, Specification


def specification(
    formula: str, box: Mapping[str, tuple[float, float]], *, steps: int | None = None, nested: str | None = None
) -> Specification:
    """What a method knows: `box` is signal -> (low, high); an episode lasts as long as the formula by default."""
    parsed = stl.parse(formula)
    return Specification(
        parsed,
        signals=tuple(box),
        low=tuple(low for low, _ in box.values()),
        high=tuple(high for _, high in box.values()),
        steps=stl.horizon(parsed) if steps is None else steps,
        dt=0.1,
        nested=None if nested is None else stl.parse(nested),
    )


def run(method: RewardMethod, traces: ArrayLike) -> tuple[Array, Array]:
    """Rewards (N, T + 1), that of sample t in column t and NaN in column 0, and memories (N, T + 1, m).

    Traces are (N, T + 1, k), or (T + 1,) for one trace of one signal.
    """
    traces = np.asarray(traces, dtype=float)
    if traces.ndim == 1:
        traces = traces[None, :, None]
    rows, samples, _ = traces.shape
    rewards, action = np.full((rows, samples), np.nan), np.zeros((rows, 1))
    memories = [method.initial_memory(traces[:, 0], np.zeros(rows, dtype=np.int64))]
    for t in range(samples - 1):
        now, after = np.full(rows, t), traces[:, t + 1]
        rewards[:, t + 1], memory = one_step(method, traces[:, t], action, after, now, memories[-1])
        memories.append(memory)
    return rewards, np.stack(memories, axis=1)
