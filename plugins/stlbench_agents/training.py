"""The training that agents share: its parameters and their types, the loop in lock-step, compiled parts, reports,
costs. Imports no Numba, which takes a while.

Names are those of Stable-Baselines3 where it has the option.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Annotated, Any, Protocol

import numpy as np
from pydantic import Field

from stlbench import contract
from stlbench.contract.compiled import is_ready, note_ready


def report_rounds(rounds: int, checkpoints: int) -> set[int]:
    """The rounds, 1..rounds, after which a policy is reported: evenly spaced, the last among them."""
    return set(np.linspace(0, rounds, min(checkpoints, rounds) + 1)[1:].round().astype(int).tolist())


_UNIT = 40
"""Multiplications that take as long as the rest of an update for each unit of a layer: fitted to times of `dqn` and
`td3` with 16 to 6000 inputs (docs/performance-tables.md), whose ratios it meets within 30 %."""
_STORED = 2 * 4  # bytes of an input in replay: in single precision, before and after the transition


def cost_of(size: int, widths: Sequence[int], outputs: int, transitions: int) -> contract.Cost:
    products = sum(before * after for before, after in pairwise([size, *widths, outputs]))
    return contract.Cost(replay=transitions * size * _STORED, update=float(products + _UNIT * (sum(widths) + outputs)))


def grid_of(actions: contract.Actions) -> contract.ActionGrid:
    if not isinstance(actions, contract.ActionGrid):
        raise contract.Unsuitable(
            f"the task's actions {', '.join(actions.names)} are continuous, and this agent chooses from a grid; "
            "give each axis a count, or take an agent such as td3"
        )
    return actions


def box_of(actions: contract.Actions) -> contract.ActionBox:
    if not isinstance(actions, contract.ActionBox):
        raise contract.Unsuitable(
            f"the task's actions {', '.join(actions.names)} are a grid, and this agent's are continuous; "
            "take an agent such as dqn"
        )
    return actions


def refuse_other(own: Sequence[int], other: Sequence[int]) -> None:
    """Raises `Unsuitable` if a policy to start from has other inputs, or other hidden layers, than the network."""
    for what, ours, theirs in (("inputs", own[:1], other[:1]), ("hidden units", own[1:], other[1:])):
        if ours != theirs:
            numbers = [" and ".join(map(str, each)) for each in (theirs, ours)]
            raise contract.Unsuitable(f"the policy to start from has {numbers[0]} {what}, and {numbers[1]} are needed")


def decay(first: float, last: float, updates: int) -> float:
    """The factor from one update's learning rate to the next, if it falls geometrically over so many updates."""
    return float((last / first) ** (1 / max(1, updates - 1)))


def rates_after(recipe: Learner, updates: int, rate: float = 0.0) -> tuple[float, float]:
    """The first learning rate of a training of so many updates from an earlier policy, and its `decay`.

    It is between the first and the last rate of the recipe, or the `rate` at which the earlier training ended if this
    is more.
    """
    first = max(rate, math.sqrt(recipe.learning_rate * recipe.learning_rate_final))
    return first, decay(first, recipe.learning_rate_final, updates)


Share = Annotated[float, Field(ge=0, le=1)]
ShareBelow1 = Annotated[float, Field(ge=0, lt=1)]
Count = Annotated[int, Field(ge=1)]
Whole = Annotated[int, Field(ge=0)]
Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]
Widths = Annotated[tuple[Count, ...], Field(min_length=1)]
"""Widths of the hidden layers of a network."""


SHARED: Mapping[str, Any] = MappingProxyType({"net_arch": [128, 128], "gamma": 0.95})
"""The entries that the recipes of all agents that learn share on the track `auto`."""


@dataclass(frozen=True, kw_only=True)
class Learner(contract.Agent):
    """An agent that trains networks with Adam."""

    net_arch: Widths = (64, 64)
    """widths of the hidden layers of each network"""
    copies: Count = 8
    """environments in lock-step"""
    batch_size: Count = 128
    """transitions in an update"""
    learning_rate: Positive = 1e-3
    """of Adam at the first update"""
    learning_rate_final: Positive = 1e-4
    """at the last update; the rate falls geometrically"""
    gamma: Share = 0.95
    """discount of a decision, that is, of `hold` steps"""


@dataclass(frozen=True, kw_only=True)
class OffPolicy(Learner):
    """A learner with a replay. Counts of transitions are of all copies together."""

    buffer_size: Count = 400_000
    """transitions kept for replay"""
    gradient_steps: Count = 1
    """updates after each step of all copies"""
    n_steps: Count = 1
    """rewards in a return before it bootstraps"""
    tau: Share = 0.01
    """weight of the online networks in an update of the targets; 1 copies them"""


@dataclass(frozen=True, kw_only=True)
class DeepQ(OffPolicy):
    """Deep Q-learning on a grid of actions, by whatever code."""

    copies: Count = 16
    buffer_size: Count = 65536
    learning_rate_final: Positive = 3e-5
    n_steps: Count = 3
    tau: Share = 0.005
    target_update_interval: Count = 1
    """updates from one update of the target network to the next"""
    exploration_initial_eps: Share = 1.0
    """probability of a random action at the start"""
    exploration_final_eps: Share = 0.05
    """what it falls to, linearly"""
    exploration_fraction: Share = 0.3
    """over this share of the budget"""
    max_grad_norm: Positive = 10.0
    """the gradient's norm is clipped to this"""

    @classmethod
    def restore(cls, arrays: contract.Arrays, actions: contract.Actions) -> contract.Policy:
        from stlbench_agents.q_policy import GreedyPolicy  # imports Numba, which parameters do not need

        return GreedyPolicy.of(arrays, grid_of(actions).shape)


@dataclass(frozen=True, kw_only=True)
class CompiledAgent(contract.Agent):
    """An agent with code that is compiled once on each machine."""

    @property
    @abstractmethod
    def compiled_part(self) -> str:
        """The part of the code that it needs."""

    @abstractmethod
    def compile(self) -> None:
        """Compile the part, or load it from the disk."""

    def uncompiled(self) -> Callable[[], None] | None:
        return None if is_ready(__package__, self.compiled_part) else self.preload

    def preload(self) -> None:
        self.compile()
        note_ready(__package__, self.compiled_part)


class LockStepLearner(Protocol):
    """The learner that is trained."""

    def act(self, observation: contract.Array) -> Any:
        """The environment's actions at observations (N, D): exploring ones, of the next step."""

    def learn(self, observation: contract.Array, action: Any, transition: contract.Transition) -> None:
        """Store that step, and update."""

    def policy(self) -> contract.Policy:
        """The policy as it is now, which later updates do not change."""

    def resume(self, policy: Any) -> None:
        """Start from the networks of an earlier policy, before the first step. Raises `Unsuitable` for other sizes."""

    def go_on(self, earlier: contract.Arrays) -> bool:
        """Go on, before the first step, with the training that gave these `kept` arrays; whether it is possible."""

    def kept(self) -> contract.Arrays:
        """The arrays from which `go_on` goes on; none if it does not."""


@dataclass(frozen=True, kw_only=True)
class LockStepAgent(OffPolicy, CompiledAgent):
    """An agent whose learner is updated after each step of all copies."""

    averaging: ShareBelow1 = 0.0
    """reported policies have an exponential average of the weights, with this weight on the past at each of their
    updates; 0: the weights themselves. Actions in training are those of the current weights"""
    reward_scale: Positive = 1.0
    """factor on rewards, which arrive divided by the method's `scale`. They are also weighted by 1 - gamma, so that
    values keep the scale of the reward; with gamma = 1 they are not"""

    resumes = True

    @abstractmethod
    def begin(self, environment: contract.Environment, seed: int, rounds: int) -> LockStepLearner:
        """A fresh learner, for so many steps of all copies. Raises `Unsuitable` if the actions are of another kind."""

    def train(self, training: contract.Training) -> contract.Policy:
        environment = training.make(self.copies)
        rounds = max(1, training.steps // (self.copies * environment.hold))
        learner, reports = self.begin(environment, training.seed, rounds), report_rounds(rounds, training.checkpoints)
        try:
            goes_on = training.earlier is not None and learner.go_on(training.earlier)
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            raise contract.Unsuitable(f"the training to go on with is damaged: {contract.cause(error)}") from error
        if training.initial is not None and not goes_on:
            learner.resume(self.restore(training.initial, environment.actions))
        observation = environment.reset()
        for done in range(1, rounds + 1):
            action = learner.act(observation)
            transition = environment.step(action)
            learner.learn(observation, action, transition)
            observation = transition.observation
            if done in reports:
                final = learner.policy()
                if training.report(final, done * self.copies * environment.hold):
                    break
        if training.keep is not None:
            training.keep(learner.kept())
        return final


class Counterfactuals:
    """Adds the counterfactual transitions of an environment, as many of each as its method asks for.

    They stand alone, as returns of one reward, and take places in the same replay. They have a generator of their own,
    so that a method without them has the same actions.
    """

    def __init__(self, environment: contract.Environment, seed: int) -> None:
        self._environment: contract.CounterfactualEnvironment | None = None
        if isinstance(environment, contract.CounterfactualEnvironment) and environment.counterfactuals > 0:
            self._environment = environment
        self._times = 0 if self._environment is None else self._environment.counterfactuals
        self._generator = np.random.default_rng([seed, 1, 1])
        self.copies = environment.count * (1 + self._times)

    def added(
        self, observation: contract.Array, action: contract.Integers, transition: contract.Transition
    ) -> tuple[contract.Array, contract.Integers, contract.Transition]:
        """A lock-step of N copies (N, D), (N,), followed by the counterfactual ones: `copies` rows each."""
        if self._environment is None:
            return observation, action, transition
        drawn = [self._environment.counterfactual(self._generator) for _ in range(self._times)]
        columns: Iterable[Any] = zip(transition, *(after for _, after in drawn), strict=True)
        observations = np.concatenate([observation, *(before for before, _ in drawn)])
        return observations, np.tile(action, 1 + self._times), contract.Transition(*map(np.concatenate, columns))
