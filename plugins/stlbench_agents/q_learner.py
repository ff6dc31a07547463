"""The training of a Q-network, compiled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from stlbench.contract import ActionGrid, Array, Arrays, Integers, Transition, Unsuitable
from stlbench_agents.engine import Network, QBuffers, actions, additive_gradient, joint_gradient
from stlbench_agents.kernels import compiled, fixed_types, inlined
from stlbench_agents.layers import OutputBuffers, Weights, step
from stlbench_agents.q_policy import GreedyPolicy, QNetwork
from stlbench_agents.replay import Batch, Memory, Replay, gather
from stlbench_agents.training import decay, rates_after, refuse_other

if TYPE_CHECKING:
    from stlbench_agents.dqn import DQN


class Schedule(NamedTuple):
    rate: float
    decay: float  # factor on the learning rate, from one update to the next
    max_norm: float
    tau: float
    interval: int
    averaging: float
    double: bool
    begun: int  # updates of the training that this one goes on with


class QLearner:
    def __init__(
        self,
        recipe: DQN,
        size: int,
        copies: int,
        grid: ActionGrid,
        seed: int | Sequence[int],
        updates: int,
    ) -> None:
        """Args: `size` D of an observation; `copies` in lock-step; `updates` in all, for the learning rate."""
        self.recipe = recipe
        self.network = QNetwork(size, recipe.net_arch, grid.shape, recipe.head)
        self.weights = Weights.of(self.network.initial(np.random.default_rng(seed)))
        self.replay = Replay(
            max(recipe.n_steps + 1, recipe.buffer_size // copies),
            copies,
            size,
            recipe.n_steps,
            recipe.gamma,
            recipe.reward_scale,
            recipe.time_limit == "terminal",
            bounded=recipe.bounded,
        )
        self.schedule = Schedule(
            recipe.learning_rate,
            decay(recipe.learning_rate, recipe.learning_rate_final, updates),
            recipe.max_grad_norm,
            recipe.tau,
            recipe.target_update_interval,
            recipe.averaging,
            recipe.double,
            0,
        )
        self._actions, self._copies, self._count, self._updates = grid.size, copies, 0, updates
        self._batch = Batch.of(recipe.batch_size, size)
        self._output_buffers = OutputBuffers.of(self.network.engine.layers, copies)
        self._buffers = QBuffers.of(self.network.engine, recipe.batch_size)
        self._update = fixed_types(_update_joint if recipe.head == "joint" else _update_additive)

    def resume(self, policy: GreedyPolicy) -> None:
        """Start from the weights of an earlier policy. Raises `Unsuitable` if it has another network."""
        own, other = self.network, policy.network
        refuse_other((own.inputs, *own.net_arch), (other.inputs, *other.net_arch))
        if own.head != other.head:
            raise Unsuitable(f"the policy to start from has head {other.head}, and the recipe {own.head}")
        self.weights = Weights.of(policy.flat)
        first, factor = rates_after(self.recipe, self._updates)
        self.schedule = self.schedule._replace(rate=first, decay=factor)

    def kept(self) -> Arrays:
        """The weights with Adam's moments, the newest transitions, and the place in the schedule."""
        rate = self.schedule.rate * self.schedule.decay ** (self._count - self.schedule.begun)
        numbers = self._count, rate
        return {"weights": self.weights.kept(), **self.replay.kept(), "numbers": np.array(numbers)}

    def go_on(self, earlier: Arrays) -> bool:
        """Go on with these `kept` arrays; False if they are of another network or of another recipe for returns."""
        if not (self.replay.fits(earlier) and self.weights.fit(earlier["weights"])):
            return False
        if len(action := earlier["action"]) and not (action.min() >= 0 and action.max() < self._actions):
            raise ValueError(f"actions should be numbers below {self._actions}")  # compiled code would not notice
        self.weights = Weights.again(earlier["weights"])
        self.replay.refill(earlier)
        count, rate = earlier["numbers"].tolist()
        self._count = int(count)
        first, factor = rates_after(self.recipe, self._updates, rate)
        self.schedule = self.schedule._replace(rate=first, decay=factor, begun=self._count)
        return True

    def act(self, observation: Array, epsilon: float, generator: np.random.Generator) -> Integers:
        """Actions (N,) at observations (N, D): each with probability `epsilon` any, else the current best."""
        rows = len(observation)
        self._output_buffers = self._output_buffers.fit(self.network.engine.layers, rows)
        chosen = np.empty(rows, np.int64)
        actions(
            self.weights.online, self.network.engine, observation, epsilon, generator.random((2, rows)),
            self._actions, self._output_buffers, chosen,
        )  # fmt: skip
        return chosen

    def learn(
        self, observation: Array, action: Integers, transition: Transition, generator: np.random.Generator
    ) -> None:
        self.replay.add(observation, action, transition)
        if self.replay.ready:
            self.update(self.replay.draw(generator, self.recipe.gradient_steps, self.recipe.batch_size))

    def update(self, first: Integers) -> None:
        """One update for each row of `first` (updates, batch size), from the transitions that begin there."""
        self._update(
            self.weights, self.network.engine, self.replay.memory, first, self._copies, self.schedule, self._count,
            self._batch, self._buffers,
        )  # fmt: skip
        self._count += len(first)

    def compile(self) -> None:
        size = self.replay.memory.observation.shape[1]
        self.act(np.zeros((1, size)), 0.0, np.random.default_rng(0))
        self.update(np.zeros((1, self.recipe.batch_size), np.int64))

    def policy(self) -> GreedyPolicy:
        """The greedy policy of the averaged weights, or of the current ones without averaging."""
        flat = self.weights.average if self.schedule.averaging else self.weights.online
        return GreedyPolicy(self.network, self.network.views(flat))


@compiled
def _update_joint(
    weights: Weights, network: Network, memory: Memory, first: Integers, copies: int, schedule: Schedule, count: int,
    batch: Batch, buffers: QBuffers,
) -> None:  # fmt: skip
    """For each row of `first` a step of Adam on the mean squared difference to the targets, and of both averages.

    The target is (1 - gamma) sum_i gamma^i r_{t+i} + gamma^n Q_target(s_{t+n}, best action there), within the bounds
    of the batch. `count` updates have been before. There is one such function for each head, since most recipes need,
    and compile, only one.
    """
    for row in range(len(first)):
        gather(memory, first[row], copies, batch)
        joint_gradient(weights.online, weights.target, network, batch, schedule.double, buffers, weights.gradient)
        _descend(weights, schedule, count + row)


@compiled
def _update_additive(
    weights: Weights, network: Network, memory: Memory, first: Integers, copies: int, schedule: Schedule, count: int,
    batch: Batch, buffers: QBuffers,
) -> None:  # fmt: skip
    """The same for an additive head."""
    for row in range(len(first)):
        gather(memory, first[row], copies, batch)
        additive_gradient(weights.online, weights.target, network, batch, schedule.double, buffers, weights.gradient)
        _descend(weights, schedule, count + row)


@inlined
def _descend(weights: Weights, schedule: Schedule, count: int) -> None:
    tau = schedule.tau if (count + 1) % schedule.interval == 0 else 0.0
    # The average begins as the plain mean of all weights so far, so that the first ones soon count little.
    share = max(1 - schedule.averaging, 1 / (count + 1)) if schedule.averaging > 0 else 0.0
    rate = schedule.rate * schedule.decay ** (count - schedule.begun)
    step(weights, rate, count + 1, schedule.max_norm, tau, share)
