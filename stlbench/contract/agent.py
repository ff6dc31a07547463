"""Agents: environment in, policy out. Import them from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Literal, NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract.arrays import Array, Arrays, Integers, Truth
from stlbench.contract.environment import Actions, Environment
from stlbench.contract.method import RewardMethod
from stlbench.contract.specification import Unsuitable
from stlbench.contract.system import System


class Policy(ABC):
    """A trained policy, frozen: later training does not change it."""

    @abstractmethod
    def act(self, observation: Array) -> Integers | Array:
        """The greedy actions, without randomness: (N, D) -> indices (N,), or vectors (N, axes)."""

    def arrays(self) -> Arrays | None:
        """Data of which `Agent.restore` makes the same policy, a few megabytes. None, the default: it is not stored.

        A policy that is not stored is scored like any other, and lost when its cell ends.
        """
        return None

    def onnx(self) -> bytes | None:
        """The policy as an ONNX model for other programs; None, the default, where it has no such form.

        Its input is `observation`, float32 (N, D). Its output is what `act` returns: `index`, int64 (N,), of a grid, or
        `action`, float64 (N, axes). Raises `Unsuitable` where a library is not installed.
        """
        return None


class StatePolicy(ABC):
    """A policy that acts on the whole state, as of a planner. Frozen, like every policy.

    It sees more than a learned policy, so tables name its agent.
    """

    @abstractmethod
    def episode(self) -> Callable[[Array, Integers, Array], Integers | Array]:
        """A function that acts in one batch of episodes, from their starts on.

        It is called at every decision with the states (N, n), their steps t (N,) and the method's memory (N, m), and
        returns actions: indices (N,) of a grid, or vectors (N, axes). It may remember its episodes.
        """

    def value(self, state: Array) -> Array:
        """Its expectation from states (N, n) at step 0: (N,), in the unit of what it maximises. NaN by default."""
        return np.full(len(state), np.nan)


class End(NamedTuple):
    """An early end of training episodes, as if `reward` were paid for ever after."""

    over: Callable[[Array], Truth]
    """Signals (..., k) to whether the episode ends there (...)."""
    active: Truth
    """(T + 1,): the samples at which it does."""
    reward: float
    """The method's `floor` in units of its `scale`, in place of the decision's own reward."""


@dataclass(frozen=True)
class Model:
    """The task and the reward as pure functions, for an agent that plans (`Agent.plans`)."""

    system: System
    method: RewardMethod
    """Its `specification` has the signals, their ranges, and the formula that is rewarded."""
    formula: stl.Formula
    """The formula that the referee scores, intervals in steps."""
    actions: Actions
    steps: int
    """T: transitions in an episode."""
    hold: int
    """Steps for which one action is held."""
    cuts: tuple[int, ...]
    """Steps at which a return stops in training, with the value of going on as before."""
    ends: tuple[End, ...]
    """The early ends of a training episode. The first counts if two come at the same decision."""
    starts: Array
    """(several, n): states from which training episodes start."""


@dataclass(frozen=True)
class Training:
    """All that an agent is given for one cell."""

    make: Callable[[int], Environment]
    """Make the environment with N copies. Its starts depend on the cell's seed, not on the method."""
    steps: int
    """Budget: environment steps of one sampling time, summed over the copies."""
    seed: int
    """For the agent's own randomness; the same for every method of a task."""
    report: Callable[[Policy | StatePolicy, int], bool | None]
    """Call it as report(policy, steps so far) at about `checkpoints` evenly spaced times and at the end. The referee
    scores the policy on starts for selection. That time does not count as training. After True, the agent may stop: the
    policy satisfies and did not get better for some time, or the budget's seconds are over."""
    checkpoints: int = 20
    model: Model | None = None
    """For an agent that plans; None for one that learns."""
    initial: Arrays | None = None
    """`Policy.arrays` of an earlier policy of this agent, whose networks the training starts from; None for fresh ones.
    Only an agent that `resumes` gets them."""


class Cost(NamedTuple):
    """The cost of training, by counting."""

    replay: int
    """Bytes of the transitions that are stored at the same time."""
    update: float
    """Work of an update, in any unit: only the ratio of two sizes of observations counts."""


class Agent(ABC):
    """A training algorithm. Its keyword-only parameters are the recipe, from the task file or their defaults.

    A task's recipe is the same for every method, and an agent that learns is not told the method. The constructor
    raises `Unsuitable` where a library is missing, and `train` where the task's actions do not fit.
    """

    @abstractmethod
    def train(self, training: Training) -> Policy | StatePolicy:
        """Spend the budget and return the final policy. The same `training.seed` gives the same policy, bit for bit."""

    # ------------------------------------------------------------------ additions

    plans: ClassVar[Literal["reward", "formula"] | None] = None
    """For an agent that plans: what it maximises, the method's reward or the formula's robustness. It gets a
    `Training.model`. Its cells show what a reward asks for, or what is possible, not learned policies."""
    trains: ClassVar[bool] = True
    """False for an agent without training, such as a controller. If an agent that trains takes no step, its cell is
    `raised`."""
    resumes: ClassVar[bool] = False
    """Whether it can start from an earlier policy (`Training.initial`, `run --init`)."""
    search_space: ClassVar[Mapping[str, tuple[float | int | str | bool, ...]]] = MappingProxyType({})
    """Values that `stlbench tune` tries for every method: parameter -> values. `hold` stands for the steps of an
    action, where it fits the task. The task's own recipe is tried too. Name what methods need differently: one that
    pays late needs a discount near 1, one that pays at once a smaller one."""

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        """The policy that gave these `Policy.arrays`, for a task with these actions. It acts the same, bit for bit.

        It works without the libraries of training. Raises `Unsuitable` for arrays of another policy or other actions,
        and by default always.
        """
        raise Unsuitable("it does not say how its policies are restored")

    def check(self, model: Model) -> None:  # noqa: B027 - by default nothing is refused
        """Raise `Unsuitable`, in little time, for a task that this agent cannot plan. Only agents that plan are asked.

        `stlbench plan` refuses a task at once if no agent passes for any method.
        """

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost | None:
        """The cost that training would have, so that the harness can refuse it. None, the default, is never refused.

        Args:
            size: D, numbers in an observation.
            actions: of the task.
            decisions: of all copies together, in the whole budget.
        """
        return None

    def uncompiled(self) -> Callable[[], None] | None:
        """A function that compiles the agent's code; None where there is nothing left to compile on this machine.

        The harness calls it before the first cell, and says so.
        """
        return None

    def preload(self) -> None:  # noqa: B027 - most have nothing to load
        """Import the libraries that training needs, and load compiled code, for many cells at once.

        It is called in the process from which cells are forked, so it starts no threads and changes nothing that
        another agent could see. Only agents of stlbench itself are called.
        """
