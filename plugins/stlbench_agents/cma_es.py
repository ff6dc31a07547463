"""A search for small policies by CMA-ES (Hansen, Ostermeier 2001), with the package `cma`.

An action is linear in the observation, plus a course over time. A policy is worth its mean return over some starts,
without a discount. No gradient and no value is learned: it shows what a reward asks for of a policy with few numbers.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from stlbench import contract
from stlbench_agents.policies import ActorPolicy
from stlbench_agents.training import Positive, refuse_other

_LEAST_STARTS = 2
_AGREE, _DISAGREE = 0.9, 0.5
"""Correlations of two halves of the starts in how they rank the candidates. Above the first, the next generation has
half as many starts; below the second, twice as many."""
_RACING = ((2, 0.3), (1, 1.0))
"""This number of runs, by turns, up to this share of the budget."""
_RESUMED = 0.2
"""The share of the spread in a search that starts from an earlier policy."""
_LAST = 10
"""The last generations, whose mean is the worth of a run."""
_FULL = 200
"""Covariances are learned of up to this many numbers of a policy; of more, their variances alone."""
_GAIN = 6.0
"""The spread of gains on an observation of one entry, over that of the course. A pole is not held by small gains."""


@dataclass(frozen=True, kw_only=True)
class CMAES(contract.Agent):
    """CMA-ES over policies that are linear in the observation, plus a course over time."""

    candidates: Annotated[int, Field(ge=4)] = 32
    """policies of a generation"""
    most_starts: Annotated[int, Field(ge=_LEAST_STARTS)] = 8
    """initial states from which each is tried, at most; those of a generation are the same for all. There are as many
    copies of the environment as candidates times starts"""
    knots: Annotated[int, Field(ge=2)] = 20
    """points in time between which the course is linear; as many as it has where a search starts from a policy"""
    spread: Positive = 1.0
    """standard deviation of the first generation's course, over half of an action's range"""

    revision = 2
    resumes = True
    discounts = False
    preference = MappingProxyType({"grid": 3, "box": 3})

    def train(self, training: contract.Training) -> contract.Policy:
        starts, steps = _LEAST_STARTS, 0
        environment = training.make(starts * self.candidates)
        family, earlier = Family.of(environment, self.knots), None
        begun = np.zeros(family.shape)
        if training.initial is not None:
            earlier = self.restore(training.initial, environment.actions)
            family = Family.of(environment, family.knots_of(earlier))
            begun = family.numbers(earlier)
        search = _Search(self, family, begun, training)
        due = np.linspace(0, training.steps, training.checkpoints + 1)[1:]
        while True:
            trial = Trial(environment, starts)
            run = search.run(steps / training.steps)
            steps += trial.play(family, run.ask(), training.steps - steps)
            if trial.is_over:
                run.tell(trial.returns.mean(axis=0))
            left = training.steps - steps
            reached = np.searchsorted(due, steps, side="right")
            is_last = not trial.is_over or left < environment.count * environment.hold
            if reached or is_last:
                policy, due = family.policy(search.best), due[reached:]
                if earlier is not None and not is_last:
                    policy, earlier = earlier, None  # so the selection never ends with a worse one
                if training.report(policy, steps) or is_last:
                    return policy
            wanted = min(trial.wanted, self.most_starts)
            if wanted != starts and wanted * self.candidates * environment.hold <= left:
                starts, environment = wanted, training.make(wanted * self.candidates)

    def playing(self, course: contract.Array, environment: contract.Environment) -> contract.Policy:
        family = Family.of(environment, len(course) + 1)
        begun = np.zeros(family.shape)
        begun[:, family.inputs :] = ((course[[*range(len(course)), -1]] - family.middle) / family.half).T
        return family.policy(begun)

    @classmethod
    def restore(cls, arrays: contract.Arrays, actions: contract.Actions) -> contract.Policy:
        if isinstance(actions, contract.ActionBox):
            return ActorPolicy.of(arrays, actions)
        from stlbench_agents.q_policy import GreedyPolicy  # imports Numba, which parameters do not need

        return GreedyPolicy.of(arrays, actions.shape)


@dataclass(frozen=True)
class Family:
    """Policies with numbers (axes, d + knots): gains on what is seen of the task, and the course at its knots.

    They do not look at a method's inputs, of which there may be hundreds: the course stands for the memory.
    """

    actions: contract.Actions
    observed: int
    """D, the size of an observation."""
    inputs: int
    """d. The first are of the task, and the time, in [-1, 1], follows."""
    knots: int

    @classmethod
    def of(cls, environment: contract.Environment, knots: int) -> Family:
        return cls(environment.actions, environment.observation_size, environment.time_column, knots)

    @property
    def shape(self) -> tuple[int, int]:
        return len(self.actions.names), self.inputs + self.knots

    @cached_property
    def middle(self) -> contract.Array:
        """The middle of each axis: (axes,)."""
        middle: contract.Array = (np.array(self.actions.low) + np.array(self.actions.high)) / 2
        return middle

    @cached_property
    def half(self) -> contract.Array:
        """Half of the range of each axis: (axes,)."""
        half: contract.Array = (np.array(self.actions.high) - np.array(self.actions.low)) / 2
        return half

    @cached_property
    def times(self) -> contract.Array:
        """The times of the knots, in [-1, 1]."""
        return np.linspace(-1, 1, self.knots)

    @property
    def spreads(self) -> contract.Array:
        """The spreads of the numbers of a policy, over that of its course."""
        spreads = np.ones(self.shape)
        spreads[:, : self.inputs] = _GAIN / np.sqrt(self.inputs)
        return spreads

    def act(self, numbers: contract.Array, observation: contract.Array) -> contract.Integers | contract.Array:
        """Actions (N,) of a grid, or (N, axes), of P policies (P, axes, d + knots), by turns, from (N, D)."""
        place = np.clip((observation[:, self.inputs] + 1) / 2, 0, 1) * (self.knots - 1)
        before = np.minimum(place.astype(np.int64), self.knots - 2)
        which = np.arange(len(observation)) % len(numbers)
        course = numbers[:, :, self.inputs :]
        first, second = course[which, :, before], course[which, :, before + 1]
        seen = observation[:, : self.inputs].reshape(-1, len(numbers), self.inputs)
        output = np.einsum("spd,pad->spa", seen, numbers[:, :, : self.inputs]).reshape(first.shape)
        output += first + (place - before)[:, None] * (second - first)
        vectors: contract.Array = np.clip(self.middle + output * self.half, self.actions.low, self.actions.high)
        return self.actions.nearest(vectors) if isinstance(self.actions, contract.ActionGrid) else vectors

    def policy(self, numbers: contract.Array) -> contract.Policy:
        """One of them (axes, d + knots), as a network with a layer of ReLU: x = relu(x) - relu(-x)."""
        gains, course = numbers[:, : self.inputs], numbers[:, self.inputs :]
        slopes = np.diff(course, axis=1) / np.diff(self.times)
        bends = np.diff(slopes, axis=1, prepend=0.0)
        hidden, out, rest = self._hidden, np.hstack([gains, -gains, bends]), course[:, 0]
        if isinstance(self.actions, contract.ActionBox):
            last = (self.half[:, None] * out).T.astype(np.float32), (self.middle + self.half * rest).astype(np.float32)
            return ActorPolicy([hidden, last], self.actions, "relu", squashed=False)
        return self._greedy(self.actions, hidden, out, rest)

    @property
    def _hidden(self) -> tuple[Any, Any]:
        """The first layer, in single precision: what is seen, its negative, and the time since each knot."""
        at = self.times[:-1]
        seen, clock = np.eye(self.observed, self.inputs), np.zeros((self.observed, len(at)))
        clock[self.inputs] = 1
        bias = np.concatenate([np.zeros(2 * self.inputs), -at])
        return np.hstack([seen, -seen, clock]).astype(np.float32), bias.astype(np.float32)

    def _greedy(
        self, grid: contract.ActionGrid, hidden: tuple[Any, Any], out: contract.Array, rest: contract.Array
    ) -> contract.Policy:
        """The nearest action of an axis has the greatest 2 a u - a^2, for the output u and an action a in [-1, 1]."""
        from stlbench_agents.q_policy import GreedyPolicy, QNetwork

        rows, biases = [np.zeros((1, out.shape[1]))], [np.zeros(1)]
        for i, axis in enumerate(map(np.array, grid.axes)):
            low, high = axis.min(), axis.max()
            each = (2 * axis - low - high) / (high - low) if high > low else np.zeros(len(axis))
            rows.append(2 * each[:, None] * out[i])
            biases.append(2 * each * rest[i] - each**2)
        last = np.concatenate(rows).astype(np.float32), np.concatenate(biases).astype(np.float32)
        network = QNetwork(self.observed, [len(hidden[1])], grid.shape, "additive")
        return GreedyPolicy(network, [*hidden, *last])

    def knots_of(self, policy: contract.Policy) -> int:
        """The knots of a policy's course, if `policy` made it."""
        hidden = len(_layers(policy)[0][1])
        return max(2, hidden - 2 * self.inputs + 1)

    def numbers(self, policy: contract.Policy) -> contract.Array:
        """The numbers that `policy` made a network of: (axes, d + knots). Raises `Unsuitable` for another network."""
        layers = _layers(policy)
        matrix, bias = layers[-1]
        if isinstance(self.actions, contract.ActionBox):
            out, rest = matrix.T / self.half[:, None], (bias - self.middle) / self.half
        else:
            greatest = np.cumsum(self.actions.shape)  # columns of the action 1 of each axis
            out, rest = matrix.T[greatest] / 2, (bias[greatest] + 1) / 2
        first = self._hidden[0]
        refuse_other([*first.shape], [len(layers[0][0]), *(len(each) for _, each in layers[:-1])])
        if not np.array_equal(layers[0][0], first):
            raise contract.Unsuitable("the policy to start from is not of cma-es")
        slopes = np.cumsum(out[:, 2 * self.inputs :], axis=1)
        steps = np.cumsum(slopes * np.diff(self.times), axis=1)
        course = rest[:, None] + np.pad(steps, ((0, 0), (1, 0)))
        return np.hstack([out[:, : self.inputs], course]).astype(np.float64)


def _layers(policy: contract.Policy) -> Sequence[tuple[Any, Any]]:
    """Matrices (inputs, outputs) and biases of a policy's network."""
    if isinstance(policy, ActorPolicy):
        return policy.layers
    from stlbench_agents.q_policy import GreedyPolicy

    assert isinstance(policy, GreedyPolicy)
    *hidden, matrix, bias = policy.weights
    return [*zip(hidden[::2], hidden[1::2], strict=True), (matrix.T, bias)]


class Trial:
    """An episode of P policies from each of some starts; the copies have the policies by turns."""

    def __init__(self, environment: contract.Environment, starts: int) -> None:
        self._environment, count = environment, environment.count
        self._sums, self._seen = np.zeros(count), environment.reset(alike=count // starts)
        self._over, self._starts = np.zeros(count, dtype=np.bool_), starts

    def play(self, family: Family, numbers: contract.Array, budget: int) -> int:
        """Play until each copy has ended one whole episode, for about at most `budget` steps. The steps taken."""
        environment, taken = self._environment, 0
        each = environment.count * environment.hold
        played = 0  # all begin together, and only the first episode of a copy counts
        while not self.is_over and (taken + each <= budget or not taken):
            step = environment.step(family.act(numbers, self._seen))
            taken += each
            counts = ~self._over
            played += 1
            # An early end pays for ever after. There is no discount, so "for ever" is for the decisions that are left.
            left = np.where(step.event == contract.Event.END, environment.decisions - played, 0)
            self._sums[counts] += (step.reward * (1 + left))[counts]
            self._over |= step.ended
            self._seen = step.observation
        return taken

    @property
    def is_over(self) -> bool:
        return bool(self._over.all())

    @property
    def returns(self) -> contract.Array:
        """(starts, P)."""
        return self._sums.reshape(self._starts, -1)

    @property
    def wanted(self) -> int:
        """The starts that the next generation needs for its ranking."""
        halves = [self.returns[half::2].mean(axis=0).argsort().argsort() for half in (0, 1)]
        agreement = np.corrcoef(*halves)[0, 1]
        if agreement < _DISAGREE:
            return 2 * self._starts
        return max(_LEAST_STARTS, self._starts // 2) if agreement > _AGREE else self._starts


class _Run:
    """A search from some numbers (axes, d + knots), with its own random numbers."""

    def __init__(
        self, agent: CMAES, family: Family, begun: contract.Array, spread: float, seed: tuple[int, int]
    ) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # it warns of optional packages that are not installed
            import cma

        generator = np.random.default_rng(seed)
        options = {
            "popsize": agent.candidates,
            "CMA_stds": family.spreads.ravel(),
            "CMA_diagonal": family.spreads.size > _FULL,
            "seed": np.nan,  # it would seed NumPy for the whole process
            "randn": lambda *shape: generator.standard_normal(shape),
            "verbose": -9,
        }
        self._shape = family.shape
        self._evolution = cma.CMAEvolutionStrategy(begun.ravel(), spread, options)
        self._worths = list[float]()

    def ask(self) -> contract.Array:
        """Policies (P, axes, d + knots)."""
        self._asked = self._evolution.ask()
        return np.stack(self._asked).reshape(-1, *self._shape)

    def tell(self, values: contract.Array) -> None:
        """Their worth (P,)."""
        self._evolution.tell(self._asked, (-values).tolist())
        self._worths.append(float(values.mean()))

    @property
    def worth(self) -> float:
        """The mean of the last generations, each from other starts."""
        return float(np.mean(self._worths[-_LAST:])) if self._worths else -np.inf

    @property
    def mean(self) -> contract.Array:
        """The mean of the distribution: (axes, d + knots)."""
        return np.array(self._evolution.mean).reshape(self._shape)


class _Search:
    """Runs by successive halving: each may get stuck, so the better one of several goes on."""

    def __init__(self, agent: CMAES, family: Family, begun: contract.Array, training: contract.Training) -> None:
        spread = agent.spread * (1.0 if training.initial is None else _RESUMED)
        self._runs = [_Run(agent, family, begun, spread, (training.seed, number)) for number in range(_RACING[0][0])]
        self._racing = self._runs

    def run(self, share: float) -> _Run:
        """The run whose turn it is after such a share of the budget."""
        stage = next((stage for stage, (_, end) in enumerate(_RACING) if share < end), len(_RACING) - 1)
        begin, (runs, end) = _RACING[stage - 1][1] if stage else 0.0, _RACING[stage]
        if len(self._racing) > runs:
            self._racing = sorted(self._racing, key=lambda run: run.worth, reverse=True)[:runs]
        return self._racing[min(runs - 1, int(runs * (share - begin) / (end - begin)))]

    @property
    def best(self) -> contract.Array:
        return max(self._runs, key=lambda run: run.worth).mean
