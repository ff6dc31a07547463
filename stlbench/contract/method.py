"""Reward methods, and the specification that they are built for. Import them from `stlbench.contract`."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import numpy as np

from stlbench import stl
from stlbench.contract.arrays import Array, Integers, Truth

Aim = Literal["recurring", "other", "sum"]
"""The aim of a training: a formula with F inside of G, which asks for something again and again; any other one; or the
sum of an episode's rewards."""


class Intractable(Exception):
    """A method would make training too dear; the message says what it would take. Ends a cell as `intractable`."""


class Unsuitable(ValueError):
    """A plugin cannot be applied to this task, or on this machine; the message names the rule that is broken."""


@dataclass(frozen=True)
class Specification:
    """The formula of a task and its signals. Intervals are in steps. A method sees no system, agent or budget."""

    formula: stl.Formula
    """The task. The referee measures its robustness at t = 0."""
    signals: tuple[str, ...]
    """Names of the k signals, in the order of the columns of samples."""
    low: tuple[float, ...]
    """Lower end of each signal's range; with `high` the box S of the paper's rho_max = max over S."""
    high: tuple[float, ...]
    steps: int
    """T: transitions in an episode. T >= horizon of the formula."""
    dt: float
    """Sampling time in seconds."""
    nested: stl.Formula | None = None
    """The same task as one outer operator over a window, `G[0,190] G[0,10] psi`, if the task file gives one."""
    can_end: bool = True
    """Whether an episode may be ended before step T by its environment; False for a `System`."""

    @cached_property
    def terms(self) -> tuple[stl.Term, ...]:
        """The conjunction of eq. 2 as terms F[a,b] psi, G[a,b] psi, F[a,c1] G[c2,b] psi.

        Raises `Unsuitable` if the formula is outside that fragment, with the place and the reason.
        """
        try:
            return stl.fragment(self.formula)
        except stl.FragmentError as error:
            raise Unsuitable(str(error)) from error

    def margin(self, psi: stl.Formula) -> Callable[[Array], Array]:
        """The robustness of `psi`, free of temporal operators, as a function of signals (..., k) -> (...)."""
        return stl.margin(psi, self.signals)

    def holds(self, psi: stl.Formula) -> Callable[[Array], Truth]:
        """The truth of `psi`, free of temporal operators, as a function of signals (..., k) -> (...)."""
        return stl.holds(psi, self.signals)

    def range(self, psi: stl.Formula) -> tuple[float, float]:
        """Sound bounds (rho_min, rho_max) of the robustness of `psi` over the box of the signals."""
        return _proven(psi, tuple(zip(self.signals, self.low, self.high, strict=True)))


@lru_cache(maxsize=4096)
def _proven(psi: stl.Formula, box: tuple[tuple[str, float, float], ...]) -> tuple[float, float]:
    """Kept, as every method asks for the ranges of all terms."""
    proven = stl.bounds(psi, {name: (low, high) for name, low, high in box})
    return proven.low, proven.high


class RewardMethod:
    """Turns a formula into the reward of each transition. Pure: the same arguments give the same reward.

    Write one of two, the other follows:

    - `arrival`, if the reward depends on nothing but a sample and its time;
    - `along`, for all others: the rewards while one action is held.

    The sample s_0 is never paid for, as no action can change it. Every other sample is paid for once: a reward r'(s, t)
    of a paper is r'(s_{t+1}, t + 1) of transition t. A constructor raises `Unsuitable` if the formula or a parameter
    does not fit.
    """

    paid_on_arrival: ClassVar[bool] = False
    """Whether the class has written `arrival`. The contract sets it."""

    def __init__(self, specification: Specification) -> None:
        self.specification = specification

    def __init_subclass__(cls, **options: Any) -> None:
        """Raises `TypeError` for a subclass that has neither `arrival` nor `along`, or writes both."""
        super().__init_subclass__(**options)
        written = [name for name in ("arrival", "along") if name in vars(cls)]
        neither = cls.arrival is RewardMethod.arrival and cls.along is RewardMethod.along
        if neither or len(written) == 2:
            has = "neither" if neither else "both"
            raise TypeError(f"{cls.__name__} must have one of arrival and along, and has {has}")
        if written == ["arrival"]:
            # A class above may have written `along`, which is then another reward than this class's.
            cls.along = RewardMethod.along  # type: ignore[method-assign]
        cls.paid_on_arrival = cls.along is RewardMethod.along

    def arrival(self, signals: Array, t: Integers) -> Array:
        """The reward of arriving at a sample, for a method without memory. A planner is many times faster with it.

        Args:
            signals: s_t, (..., k), in the signals' units.
            t: step of the sample, (...), each in 1..T; rows may be at different times.

        Returns:
            The rewards (...).
        """
        raise TypeError(f"{type(self).__name__} has no arrival: its reward depends on more than a sample and its time")

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """The rewards while one action is held for h steps.

        Args:
            samples: s_t, ..., s_{t+h}, (h + 1, N, k), in the signals' units.
            action: what the system was given, (N, number of action axes), in the actions' units.
            t: step of the first transition, (N,), each in 0..T-h; rows may be at different times.
            memory: at s_t, (N, m). Not to be changed in place.

        Returns:
            The rewards (h, N) and the memory at s_{t+h}, (N, m).
        """
        return self.arrival(samples[1:], t + np.arange(1, len(samples))[:, None]), memory

    # ------------------------------------------------------------------ additions: for methods with a memory

    memory_size: int = 0
    """m: numbers that the method carries from step to step."""

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        """The memory at the first sample of an episode: signals (N, k) at steps t (N,) -> (N, m). Zeros by default.

        t is 0 in every episode that is scored. If a task trains with exploring starts (`training.exploring`),
        episodes may begin later, with nothing known of the steps before.
        """
        return np.zeros((len(signals), self.memory_size))

    @cached_property
    def input_size(self) -> int:
        """How many `inputs` the policy sees: `memory_size` by default."""
        return self.memory_size

    def inputs(self, memory: Array) -> Array:
        """The policy's view of the memory, about in [-1, 1]: (N, m) -> (N, `input_size`). All of it by default."""
        return memory

    # ------------------------------------------------------------------ additions: the size of rewards

    scale: float = 1.0
    """About the largest magnitude of the reward. Training divides by it, so that one recipe serves every method."""

    @cached_property
    def floor(self) -> float:
        """The least reward of a step, in the method's unit: -`scale` by default.

        A training episode that ends early (`training.ends`) counts as if the floor were paid for ever after; for a
        method with `can_end` it counts once.
        """
        return -self.scale

    extension: str = ""
    """Why the task is outside the form of the method's publication, in a few words; empty inside it. Tables mark it."""

    preference: ClassVar[Mapping[Aim, int]] = MappingProxyType({})
    """Aim of a training -> its place among the methods that `stlbench solve` and `method="auto"` try first, 1 the
    first. Those without a place follow. A subclass has a place only if its own body gives one."""

    # ------------------------------------------------------------------ additions: a memory that is a state machine

    can_end: bool = False
    """Whether the method has an `over`."""

    def over(self, memory: Array) -> Truth:
        """Whether nothing more is paid, whatever comes: memories (N, m) -> (N,).

        A training episode ends there; what is scored runs to T. After such a memory every reward is 0, and every later
        memory is over too.
        """
        return np.zeros(len(memory), dtype=np.bool_)

    counterfactuals: int = 0
    """How many other memories each transition should be learned from, beside its own; 0 without a `counterfactual`."""

    def counterfactual(self, signals: Array, t: Integers, memory: Array, chance: Array) -> Array:
        """Another memory that the copies could have at a sample.

        `along` says what a transition from it would pay. An agent may learn from that as if it had happened
        (`CounterfactualEnvironment`).

        Args:
            signals: s_t, (N, k).
            t: step of the sample, (N,).
            memory: of the copies, (N, m). Not to be changed in place. It may be drawn too.
            chance: (N, m), uniform in [0, 1): the only source of randomness.

        Returns:
            The other memories (N, m).
        """
        return memory
