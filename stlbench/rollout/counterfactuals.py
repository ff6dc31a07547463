"""A step once more, as if each copy had had another memory of the method: what agents may learn from beside it."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from stlbench.contract import Array, Integers, RewardMethod, Transition, Truth
from stlbench.rollout import faults


class Taken(NamedTuple):
    """A step of N copies that was taken."""

    seen: Array
    """(N, D): the observations before it."""
    t: Integers
    """(N,), before it."""
    memory: Array
    """(N, m), before it."""
    samples: Array
    """(hold + 1, N, k)."""
    action: Array
    """(N, axes)."""
    transition: Transition
    fixed: Truth
    """(N,): the task or the world ended the episode. What it was paid for that says nothing of the method."""


class _Paying(Protocol):
    """What of the simulator matters here."""

    method: RewardMethod

    def paid(self, samples: Array, vectors: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """See `Simulator.paid`."""

    def over(self, memory: Array) -> Truth:
        """See `Simulator.over`."""


def counterfactual(simulator: _Paying, taken: Taken, generator: np.random.Generator) -> tuple[Array, Transition]:
    """What would have been seen (N, D), and the transition (see `contract.Environment.counterfactual`)."""
    method, real, fixed = simulator.method, taken.transition, taken.fixed
    chance = generator.random(taken.memory.shape)
    other = method.counterfactual(taken.samples[0], taken.t, taken.memory, chance)
    faults.check_memory(method, other, taken.t)
    memory = np.where(fixed[:, None], taken.memory, other)
    reward, after = simulator.paid(taken.samples, taken.action, taken.t, memory)
    over = simulator.over(after) & ~fixed if method.can_end else np.zeros_like(fixed)
    by_method = real.once & ~fixed if real.once is not None else np.zeros_like(fixed)
    limit = taken.t + len(taken.samples) - 1 >= method.specification.steps
    discount = np.where(fixed, real.discount, np.where(over, 0.0, 1.0))
    transition = real._replace(
        reward=np.where(fixed, real.reward, reward / method.scale),
        arrived=_with_inputs(method, real.arrived, after),
        discount=discount,
        cut=np.ones_like(fixed),
        ended=over | limit | (real.ended & ~by_method),
        once=discount == 0 if method.can_end else None,
    )
    return _with_inputs(method, taken.seen, memory), transition


def _with_inputs(method: RewardMethod, observation: Array, memory: Array) -> Array:
    """Observations (N, D), whose last columns are the method's inputs, with those of other memories (N, m)."""
    changed = observation.copy()
    changed[:, observation.shape[1] - method.input_size :] = method.inputs(memory)
    return changed
