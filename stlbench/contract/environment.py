"""Actions, environments and transitions, from which an agent learns. Import them from `stlbench.contract`."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from itertools import pairwise
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from stlbench.contract.arrays import Array, Integers, Truth


@dataclass(frozen=True)
class ActionGrid:
    """A finite set of actions: the product of evenly spaced axes. Index i runs over the last axis fastest."""

    names: tuple[str, ...]
    axes: tuple[tuple[float, ...], ...]
    robots: tuple[int, ...] = ()
    """How many of the axes, in their order, each robot has: (2, 2, 2). Empty where the task has one robot."""

    @cached_property
    def parts(self) -> tuple[ActionGrid, ...]:
        """The grid of each robot, in the order of the axes.

        The index of a joint action is `np.ravel_multi_index` of the robots' indices.
        """
        ends = np.cumsum([0, *(self.robots or [len(self.axes)])]).tolist()
        return tuple(ActionGrid(self.names[i:j], self.axes[i:j]) for i, j in pairwise(ends))

    @cached_property
    def low(self) -> tuple[float, ...]:
        """Least value of each axis."""
        return tuple(min(axis) for axis in self.axes)

    @cached_property
    def high(self) -> tuple[float, ...]:
        """Greatest value of each axis."""
        return tuple(max(axis) for axis in self.axes)

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """Actions along each axis: (21, 13)."""
        return tuple(len(axis) for axis in self.axes)

    @cached_property
    def size(self) -> int:
        """The number A of actions: 273."""
        return math.prod(self.shape)

    @cached_property
    def vectors(self) -> Array:
        """All actions, (A, number of axes), in the actions' units."""
        return np.stack([mesh.ravel() for mesh in np.meshgrid(*self.axes, indexing="ij")], axis=-1)


@dataclass(frozen=True)
class ActionBox:
    """Continuous actions: every vector between `low` and `high`, in the actions' units."""

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]


Actions = ActionGrid | ActionBox
"""The actions of a task: a grid where its task file counts values along each axis, else a box."""


class Event(IntEnum):
    """The effect of a transition on the episode of a copy. The policy knows the time, so T is no terminal state."""

    GOES_ON = 0
    CUT = 1
    """A return of several rewards stops here (`training.cuts`), and bootstraps; the episode goes on."""
    TIME_LIMIT = 2
    """The episode is over: at step T, or interrupted before. A return bootstraps."""
    END = 3
    """The episode is over (`training.ends`). Nothing follows: the reward counts for ever, r / (1 - gamma)."""
    OVER = 4
    """The episode is over, for a method that can end. Nothing follows: the reward counts once."""


class Transition(NamedTuple):
    """The result of `Environment.step`, for N copies."""

    observation: Array
    """(N, D): what to act on next."""
    reward: Array
    """(N,): the method's reward, averaged over the steps that the action was held, over the method's `scale`."""
    arrived: Array
    """(N, D): what the action led to, to bootstrap from. It differs from `observation` only where `cut`."""
    event: NDArray[np.int8]
    """(N,): an `Event` of each copy. The three properties below read it."""

    @property
    def discount(self) -> Array:
        """(N,): 1 to bootstrap from `arrived`, 0 where nothing follows."""
        return (self.event < Event.END).astype(np.float64)

    @property
    def cut(self) -> Truth:
        """(N,): a return of several rewards stops here."""
        return self.event > Event.GOES_ON

    @property
    def ended(self) -> Truth:
        """(N,): the episode is over, and `observation` belongs to the next one."""
        return self.event > Event.CUT


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


@runtime_checkable
class CounterfactualEnvironment(Environment, Protocol):
    """An addition, for agents that learn from other memories too, as `dqn` does with cfer, counters and machine."""

    counterfactuals: int
    """How many times an agent should ask for a `counterfactual` of each step; 0 where the method has none."""

    def counterfactual(self, generator: np.random.Generator) -> tuple[Array, Transition]:
        """The last step once more, as if each copy had had another memory of the method, drawn by the generator.

        It costs no environment step: the method says what the same samples would have paid. Each such transition is
        `cut`. If the task or the environment ended the episode, it is the same transition again.

        Returns:
            The observation that the step would have had, (N, D), and the transition; its `observation` is of no use.
        """
