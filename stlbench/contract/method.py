"""Reward methods: the reward of a transition, and its own memory. Import them from `stlbench.contract`."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from stlbench.contract.arrays import Array, Integers, Truth
from stlbench.contract.specification import Specification
from stlbench.contract.stepwise import along_by_steps, complete, refuse_circle


class RewardMethod:
    """Turns a formula into the reward of each transition. Pure: the same arguments give the same reward.

    Subclass it, take the parameters as keyword-only arguments, and write one of three; the others follow from it:

    - `arrival`, where the reward is a function of the sample that is arrived at, and of time, alone;
    - `step`, the reward of one transition;
    - `along`, those of one held action at once, which can be faster than `step`.

    A method that must remember (flags, a history of states) sets `memory_size` and carries its memory along; the policy
    is shown `inputs(memory)`. A constructor raises `Unsuitable` where the formula or a parameter does not fit. It need
    not count its inputs: the harness refuses what makes training too dear (`Agent.cost`). For what tables and figures
    may show of a method, see `stlbench.contract.presentation`.

    Two additions are for methods whose memory is a state machine, or like one: `over`, where all is decided, and
    `counterfactual`, from which memories else a transition can be learned.

    One transition t of N copies, signals s:

    ============  ======================  ======================  =========================
    at            the first, t = 0        a middle one            the last, t = T - 1
    ============  ======================  ======================  =========================
    signals       s_0                     s_t                     s_{T-1}
    next_signals  s_1                     s_{t+1}                 s_T, the end of the trace
    memory        `initial_memory(s_0)`   what `step` returned    what `step` returned
    ============  ======================  ======================  =========================

    So a reward of the paper, r'(s, t), is paid on arrival: r'(s_{t+1}, t + 1). The sample s_0 is never paid for, as no
    action can change it; every other sample of the trace is paid for once.
    """

    memory_size: int = 0
    """m: numbers that the method carries from step to step; 0 for a method without memory."""
    paid_on_arrival: ClassVar[bool] = False
    """Whether the class has written `arrival`; set by the contract itself."""
    can_end: bool = False
    """Whether the method can say, by `over`, that nothing more is paid in an episode."""
    counterfactuals: bool = False
    """Whether it says, by `counterfactual`, which other memories a transition could have had."""
    scale: float = 1.0
    """About the largest magnitude of the reward. Training divides by it, for every method alike, so that one recipe
    of the agent serves methods whose rewards are metres and methods whose rewards are flags."""
    extension: str = ""
    """Why the task is outside the form that the method's source was published for, in a few words; empty inside it."""

    @property
    def floor(self) -> float:
        """The least that the method pays for a step, in its own unit: -`scale` unless it says otherwise.

        A training episode that ends early (`training.ends`) counts as if this were paid for ever after, so that no
        method is paid less for an end than for the worst that it knows, and none more. With `can_end` it is paid once.
        """
        return -self.scale

    @property
    def input_size(self) -> int:
        """How many `inputs` the policy is shown: `memory_size` unless the method says otherwise."""
        return self.memory_size

    def __init__(self, specification: Specification) -> None:
        self.specification = specification

    def __init_subclass__(cls, **options: Any) -> None:
        """Raises `TypeError` for a subclass that writes none of `arrival`, `step` and `along`, or more than one."""
        super().__init_subclass__(**options)
        complete(cls, RewardMethod)

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        """The memory at the first sample of an episode: signals (N, k) at steps t (N,) -> (N, m). Zeros by default.

        t is 0 in every episode that is scored. Where a task trains with exploring starts (`training.exploring`),
        some episodes begin at a later time, with nothing known of what was before.
        """
        return np.zeros((len(signals), self.memory_size))

    def arrival(self, signals: Array, t: Integers) -> Array:
        """The reward of arriving at a sample, for a method without memory to which nothing else matters.

        What pays for samples alone can be planned for much faster than what pays for transitions (`Model`).

        Args:
            signals: s_t, (..., k), in the signals' units.
            t: step index of the sample, (...), each in 1..T; rows may be at different times.

        Returns:
            The rewards (...).
        """
        raise TypeError(f"{type(self).__name__} is not paid for samples alone: it has no arrival")

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        """The reward of one transition, and the memory after it.

        Args:
            signals: s_t, (N, k), in the signals' units.
            action: what the system was given, (N, number of action axes), in the actions' units.
            next_signals: s_{t+1}, (N, k).
            t: step index of the transition, (N,), each in 0..T-1; rows may be at different times.
            memory: what `initial_memory` or the last `step` returned, (N, m). Not to be changed in place.

        Returns:
            The reward (N,) and the next memory (N, m).
        """
        refuse_circle(self, RewardMethod, "step")
        if self.paid_on_arrival:
            return self.arrival(next_signals, t + 1), memory
        rewards, memory = self.along(np.stack([signals, next_signals]), action, t, memory)
        return rewards[0], memory

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """The rewards while one action is held for h steps, the same as by `step` after `step`.

        Args:
            samples: s_t, ..., s_{t+h}, (h + 1, N, k).
            action: as for `step`, (N, number of action axes).
            t: step index of the first transition, (N,).
            memory: at s_t, (N, m). Not to be changed in place.

        Returns:
            The rewards (h, N) and the memory at s_{t+h}, (N, m).
        """
        refuse_circle(self, RewardMethod, "along")
        if self.paid_on_arrival:
            return self.arrival(samples[1:], t + np.arange(1, len(samples))[:, None]), memory
        return along_by_steps(self, samples, action, t, memory)

    def inputs(self, memory: Array) -> Array:
        """What the policy sees of the memory, about in [-1, 1]: (N, m) -> (N, `input_size`). All of it by default."""
        return memory

    def over(self, memory: Array) -> Truth:
        """Whether nothing more is paid, whatever comes, for memories (N, m) -> (N,). Asked where `can_end` alone.

        A training episode ends there, which saves the steps that are left. It remains so: after such a memory every
        reward is 0, and every later memory says the same. What is scored runs to T all the same.
        """
        return np.zeros(len(memory), dtype=np.bool_)

    def counterfactual(self, signals: Array, t: Integers, memory: Array, chance: Array) -> Array:
        """Another memory that the copies could have at a sample. Asked where `counterfactuals` alone.

        What a transition from it would pay, and where it would lead, follows by `along`: the world would have done the
        same. An agent may learn from that as if it had happened, at no cost of environment steps (`Environment`).

        Args:
            signals: s_t, (N, k).
            t: step index of the sample, (N,).
            memory: that of the copies, (N, m). Not to be changed in place. It may be drawn again.
            chance: (N, m), uniform in [0, 1): all the randomness that there is.

        Returns:
            The other memories (N, m).
        """
        return memory
