"""What an agent is given that plans. Import it from `stlbench.contract`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from stlbench import stl
from stlbench.contract.actions import Actions
from stlbench.contract.arrays import Array, Truth
from stlbench.contract.method import RewardMethod
from stlbench.contract.system import System


class End(NamedTuple):
    """Where training episodes end early, as if `reward` were paid for ever after."""

    over: Callable[[Array], Truth]
    """Signals (..., k) to whether the episode ends there (...)."""
    active: Truth
    """(T + 1,): the samples at which it does."""
    reward: float
    """In units of the method's `scale`, in place of the method's own of that decision: its `floor`."""


@dataclass(frozen=True)
class Model:
    """The task and the reward as pure functions: what an agent is given that plans (`Agent.plans`), and no learner."""

    system: System
    method: RewardMethod
    """Its `specification` has the signals, their ranges, and the formula as it is rewarded."""
    formula: stl.Formula
    """What the referee scores, intervals in steps."""
    actions: Actions
    steps: int
    """T: transitions in an episode."""
    hold: int
    """Steps for which one action is held."""
    cuts: tuple[int, ...]
    """Steps at which a return stops in training, with the value of going on as before."""
    ends: tuple[End, ...]
    """Where a training episode ends early. Of two at the same decision, the first counts."""
    starts: Array
    """(several, n): states from which training episodes start."""
