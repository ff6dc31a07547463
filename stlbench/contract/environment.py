"""What an agent learns from: a task with a method's reward, N copies. Import it from `stlbench.contract`."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from stlbench.contract.actions import Actions
from stlbench.contract.arrays import Array, Integers, Truth


class Transition(NamedTuple):
    """What `Environment.step` returns, for N copies. The policy knows the time, so its limit is no terminal state.

    =========================================  ========  =====  =======
    what happened                              discount  cut    ended
    =========================================  ========  =====  =======
    the episode goes on                        1         False  False
    a boundary was crossed (`training.cuts`)   1         True   False
    the time limit T, or broken off before it  1         True   True
    an end (`training.ends`): nothing follows  0         True   True
    all is over (`RewardMethod.over`)          0         True   True
    =========================================  ========  =====  =======
    """

    observation: Array
    """(N, D): what to act on next."""
    reward: Array
    """(N,): the method's reward, averaged over the steps that the action was held, over the method's `scale`."""
    arrived: Array
    """(N, D): what the action led to, to bootstrap from; differs from `observation` only where `cut`."""
    discount: Array
    """(N,): 1 to bootstrap; 0 where nothing follows, and `reward` counts as if paid for ever, r / (1 - gamma)."""
    cut: Truth
    """(N,): a return of several rewards stops here, though the episode may go on."""
    ended: Truth
    """(N,): the episode is over, and `observation` is of the next one."""
    once: Truth | None = None
    """(N,): where nothing follows, whether `reward` counts once, as for a method that can end; None where none does."""


class Environment(Protocol):
    """N copies of a task with a method's reward, in lock-step, restarting by themselves."""

    count: int
    """N."""
    observation_size: int
    """D: features, time t/T scaled to [-1, 1], and the method's inputs."""
    actions: Actions
    hold: int
    """Steps for which one action is held; the formula still sees every step."""

    def reset(self) -> Array:
        """Start N episodes: the first observation, (N, D)."""

    def step(self, action: Integers | Array) -> Transition:
        """Hold actions for `hold` steps: indices (N,) of a grid, or vectors (N, axes), clipped to the actions' ends."""

    counterfactuals: bool
    """Whether `counterfactual` can be asked for."""

    def counterfactual(self, generator: np.random.Generator) -> tuple[Array, Transition]:
        """The last step once more, as if each copy had had another memory of the method, drawn by the generator.

        It costs no environment step: the method says what the same samples would have paid. Each such transition stands
        alone (`cut`). Where the step ended an episode by other means than the method's, it is that step again.

        Returns:
            What would have been seen before the step, (N, D), and the transition; its `observation` is of no use.
        """
