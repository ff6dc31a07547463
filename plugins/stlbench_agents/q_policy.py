"""A Q-network with ReLU layers: its shape, and its greedy policy.

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

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, Arrays, Integers, Policy, Unsuitable
from stlbench_agents.engine import Network, greedy_actions
from stlbench_agents.layers import layout, size_of, views
from stlbench_agents.policies import Graph, Head

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
