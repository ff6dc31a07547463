"""Agents, and the environments that they learn from: actions, transitions, training, policies. Import them from
`stlbench.contract`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract.arrays import Array, Arrays, Integers, Truth
from stlbench.contract.method import RewardMethod, Unsuitable
from stlbench.contract.task import System

ActionKind = Literal["grid", "robots", "box"]
"""A grid of actions, the grid of several robots, continuous actions."""


@dataclass(frozen=True)
class ActionGrid:
    """A finite set of actions: the product of evenly spaced axes. Index i runs over the last axis fastest."""

    names: tuple[str, ...]
    axes: tuple[tuple[float, ...], ...]
    robots: tuple[int, ...] = ()
    """The number of axes of each robot, in their order: (2, 2, 2). Empty if the task has one robot."""

    @property
    def kind(self) -> ActionKind:
        """The kind of actions that agents name in their `preference`."""
        return "robots" if len(self.robots) > 1 else "grid"

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

    def nearest(self, vectors: Array) -> Integers:
        """The index (N,) of the action that is nearest to each of the vectors (N, axes), axis by axis."""
        axes = zip(vectors.T, self.axes, strict=True)
        places = [np.abs(np.subtract.outer(column, axis)).argmin(axis=1) for column, axis in axes]
        index: Integers = np.ravel_multi_index(places, self.shape)
        return index


@dataclass(frozen=True)
class ActionBox:
    """Continuous actions: every vector between `low` and `high`, in the actions' units."""

    names: tuple[str, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    kind: ClassVar[ActionKind] = "box"


Actions = ActionGrid | ActionBox
"""The actions of a task: a grid if its task file counts values along each axis, else a box."""


class Event(IntEnum):
    """The effect of a transition on the episode of a copy. The policy knows the time, so T is no terminal state.

    The order counts: `Transition.discount`, `cut` and `ended` compare by it.
    """

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
    """(N, D): the observation to act on next."""
    reward: Array
    """(N,): the method's reward, averaged over the steps that the action was held, over the method's `scale`."""
    arrived: Array
    """(N, D): the observation that the action led to, to bootstrap from. It is `observation` unless `cut`."""
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
    time_column: int
    """The column of the observation that has the time."""
    decisions: int
    """Actions of a whole episode."""

    def reset(self, alike: int = 1) -> Array:
        """Start N episodes: the first observation, (N, D). So many in a row begin alike, at step 0 if more than one."""

    def step(self, action: Integers | Array) -> Transition:
        """Hold actions for `hold` steps: indices (N,) of a grid, or vectors (N, axes), clipped to the actions' ends."""


@runtime_checkable
class CounterfactualEnvironment(Environment, Protocol):
    """An addition, for agents that learn from other memories too, as `dqn` does with cfer, counters and machine."""

    counterfactuals: int
    """The number of `counterfactual`s that an agent should ask for after each step; 0 if the method has none."""

    def counterfactual(self, generator: np.random.Generator) -> tuple[Array, Transition]:
        """The last step once more, as if each copy had had another memory of the method, drawn by the generator.

        It costs no environment step: the method says what the same samples would have paid. Each such transition is
        `cut`. If the task or the environment ended the episode, it is the same transition again.

        Returns:
            The observation that the step would have had, (N, D), and the transition; its `observation` is of no use.
        """


class Policy(ABC):
    """A trained policy, frozen: later training does not change it."""

    @abstractmethod
    def act(self, observation: Array) -> Integers | Array:
        """The greedy actions, without randomness: (N, D) -> indices (N,), or vectors (N, axes)."""

    def arrays(self) -> Arrays | None:
        """A few megabytes from which `Agent.restore` makes the same policy. None, the default: it is not stored.

        A policy that is not stored is scored like any other, and lost when its cell ends.
        """
        return None

    def onnx(self) -> bytes | None:
        """The policy as an ONNX model for other programs; None, the default, if it has no such form.

        Its input is `observation`, float32 (N, D). Its output is that of `act`: `index`, int64 (N,), for a grid, or
        `action`, float64 (N, axes). Raises `Unsuitable` if a library is not installed.
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
        """The sum that it expects from states (N, n) at step 0: (N,), in the unit that it maximises. NaN by default."""
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

    @property
    def decisions(self) -> int:
        """The number of actions in an episode."""
        return self.steps // self.hold


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
    earlier: Arrays | None = None
    """The arrays that an earlier training of the same task and method gave to `keep`; `initial` is its last policy."""
    keep: Callable[[Arrays], None] | None = None
    """Call it at the end with the arrays from which this training can go on, such as those of critics and replay. None
    if no training will."""


class Cost(NamedTuple):
    """The cost of training, by counting."""

    replay: int
    """Bytes of the transitions that are stored at the same time."""
    update: float
    """Work of an update, in any unit: only the ratio of two sizes of observations counts."""


class Agent(ABC):
    """A training algorithm. Its keyword-only parameters are the recipe, from the task file or their defaults.

    A task's recipe is the same for every method, and an agent that learns is not told the method. The constructor
    raises `Unsuitable` if a library is missing, and `train` if the task's actions do not fit.
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
    discounts: ClassVar[bool] = True
    """Whether later rewards count less. If not, `stlbench solve` takes a method with a place for `sum`."""
    search_space: ClassVar[Mapping[str, tuple[float | int | str | bool, ...]]] = MappingProxyType({})
    """Values that `stlbench tune` tries for every method: parameter -> values. `hold` stands for the steps of an
    action, where it fits the task. The task's own recipe is tried too. Name what methods need differently: one that
    pays late needs a discount near 1, one that pays at once a smaller one."""

    recipe: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    """Its parameters on the track `auto`, the same for every task, of values that JSON has; others keep their defaults.
    A `gamma` here is the least: rules raise it for a task that lasts long, or asks again and again."""
    second_recipe: ClassVar[Mapping[str, Any]] = MappingProxyType({})
    """Numbers and words of a second recipe, where it differs from `recipe`. With it `stlbench solve` races on an
    environment if the first recipe learned nothing."""
    preference: ClassVar[Mapping[ActionKind, int]] = MappingProxyType({})
    """Kind of actions -> its place among the agents to train with if none is named, 1 the first. The first agent of
    stlbench trains a task without recipes, whatever is installed. The next one also races in a long `stlbench solve`.
    A subclass has a place only if its own body gives one."""

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        """The policy that gave these `Policy.arrays`, for a task with these actions. It acts the same, bit for bit.

        It works without the libraries of training. Raises `Unsuitable` for arrays of another policy or other actions,
        and by default always.
        """
        raise Unsuitable("it does not say how its policies are restored")

    def playing(self, course: Array, environment: Environment) -> Policy | None:
        """A policy that takes the actions of a course (decisions, axes) in turn, whatever it sees.

        `stlbench solve` trains from it where it knows a course that satisfies. None, the default: there is none.
        """
        return None

    def check(self, model: Model) -> None:  # noqa: B027 - by default nothing is refused
        """Raise `Unsuitable`, in little time, for a task that this agent cannot plan. Only agents that plan are asked.

        `stlbench plan` refuses a task at once if no agent passes for any method.
        """

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost | None:
        """The cost that training would have, so that the harness can refuse it. None, the default, is never refused.

        Args:
            size: D, numbers in an observation.
            actions: the task's.
            decisions: the number in the whole budget, of all copies together.
        """
        return None

    def uncompiled(self) -> Callable[[], None] | None:
        """A function that compiles the agent's code; None if nothing is left to compile on this machine.

        The harness calls it before the first cell, and says so.
        """
        return None

    def preload(self) -> None:  # noqa: B027 - most have nothing to load
        """Import the libraries that training needs, and load compiled code, for many cells at once.

        It is called in the process from which cells are forked, so it starts no threads and changes nothing that
        another agent could see. Only agents of stlbench itself are called.
        """
