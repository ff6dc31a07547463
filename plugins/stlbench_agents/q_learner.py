"""A Q-network with ReLU layers: its shape, its greedy policy, and its training, compiled.

joint:     one output an action, Q(s, .) in R^A.
additive:  V(s) + sum_i (A_i(s, a_i) - mean A_i(s, .)) over the axes of the action grid: 1 + 21 + 13 outputs where a
           joint head has 273, and the maximum is found axis by axis (action branching, Tavakoli, Pardo, Kormushev
           2018).

All weights lie in one flat vector, so that an optimiser's step and a target's update are one loop each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionGrid, Array, Arrays, Integers, Policy, Transition, Unsuitable
from stlbench_agents.engine import Network, QBuffers, actions, additive_gradient, greedy_actions, joint_gradient
from stlbench_agents.kernels import compiled, fixed_types, inlined
from stlbench_agents.layers import OutputBuffers, Weights, decay, layout, size_of, step, views
from stlbench_agents.replay import Batch, Memory, Replay, gather
from stlbench_agents.training import Head, refuse_other, resumed_rate

if TYPE_CHECKING:
    from stlbench_agents.dqn import DQN
    from stlbench_agents.policies import Graph

Single = NDArray[np.float32]


class QNetwork:
    """The shape of a Q-network. Holds no weights.

    Weights alternate matrices and biases: hidden layers (in, out), the last layer (outputs, in), so that the row of
    an action lies in one piece.
    """

    def __init__(self, inputs: int, net_arch: Sequence[int], grid: tuple[int, ...], head: Head) -> None:
        self.inputs, self.net_arch, self.grid, self.head = inputs, tuple(net_arch), grid, head
        self.axes = (math.prod(grid),) if head == "joint" else grid
        layers = layout((inputs, *net_arch, sum(self.axes) + (head == "additive")))
        self.size = size_of(layers)
        self.engine = Network(layers, np.array(self.axes), head == "additive")

    def initial(self, generator: np.random.Generator) -> Single:
        """Fresh weights as one flat vector: He's normal initialisation, a small last layer, biases 0."""
        flat = np.zeros(self.size, dtype=np.float32)
        matrices = self.views(flat)[::2]
        for matrix in matrices:
            spread = 0.1 / math.sqrt(matrix.shape[1]) if matrix is matrices[-1] else math.sqrt(2 / matrix.shape[0])
            matrix[:] = generator.standard_normal(matrix.shape, dtype=np.float32) * spread
        return flat

    def views(self, flat: Single) -> list[Single]:
        return views(flat, self.engine.layers)


class GreedyPolicy(Policy):
    def __init__(self, network: QNetwork, weights: Sequence[Single]) -> None:
        self.network, self.flat = network, np.concatenate([weight.ravel() for weight in weights])

    @property
    def weights(self) -> list[Single]:
        return self.network.views(self.flat)

    def act(self, observation: Array) -> Integers:
        """The greedy actions' indices: (N, D) -> (N,). Another D never reaches compiled code: `ValueError`."""
        if observation.shape[1:] != (self.network.inputs,):
            raise ValueError(f"the network has {self.network.inputs} inputs, observations are {observation.shape[1:]}")
        return greedy_actions(self.flat, self.network.engine, observation)

    def arrays(self) -> Arrays:
        network = self.network
        return {
            "weights": self.flat,
            "widths": np.array([network.inputs, *network.net_arch]),
            "grid": np.array(network.grid),
            "head": np.array(network.head),
        }

    def onnx(self) -> bytes:
        from stlbench_agents.policies import Graph

        graph = Graph()
        return graph.model(self.network.inputs, self.index_in(graph), "index")

    def index_in(self, graph: Graph) -> str:
        *hidden, matrix, bias = self.weights
        layers = [*zip(hidden[::2], hidden[1::2], strict=True), (matrix.T, bias)]
        values = graph.perceptron(layers, "Relu")
        sizes = self.network.engine.axes.tolist()
        ends = np.cumsum([int(self.network.engine.additive), *sizes]).tolist()
        return graph.joined([graph.first_largest(values, *each) for each in pairwise(ends)], sizes)

    @classmethod
    def of(cls, arrays: Arrays, grid: tuple[int, ...]) -> GreedyPolicy:
        if (own := tuple(arrays["grid"].tolist())) != grid:
            raise Unsuitable(f"the policy chooses among {_times(own)} actions, the task has {_times(grid)}")
        widths = arrays["widths"]
        if widths.ndim != 1 or widths.dtype.kind != "i" or not widths.size or widths.min() < 1:
            raise Unsuitable("the widths of a network are whole numbers, at least 1")
        inputs, *hidden = widths.tolist()
        network = QNetwork(inputs, hidden, grid, "additive" if arrays["head"] == "additive" else "joint")
        weights = arrays["weights"]
        if weights.shape != (network.size,) or weights.dtype != np.float32:
            raise Unsuitable(
                f"a network of these widths has {network.size} weights of type float32, "
                f"got {weights.shape} of type {weights.dtype}"
            )
        return cls(network, [weights])


def _times(grid: tuple[int, ...]) -> str:
    return " x ".join(map(str, grid))


class Schedule(NamedTuple):
    rate: float
    decay: float  # factor on the learning rate, from one update to the next
    max_norm: float
    tau: float
    interval: int
    averaging: float
    double: bool


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
        first = resumed_rate(self.recipe)
        self.schedule = self.schedule._replace(
            rate=first, decay=decay(first, self.recipe.learning_rate_final, self._updates)
        )

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
    step(weights, schedule.rate * schedule.decay**count, count + 1, schedule.max_norm, tau, share)
