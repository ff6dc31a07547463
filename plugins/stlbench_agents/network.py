"""The shape of a Q-network with ReLU layers, and its greedy policy.

joint:     one output an action, Q(s, .) in R^A.
additive:  V(s) + sum_i (A_i(s, a_i) - mean A_i(s, .)) over the axes of the action grid: 1 + 21 + 13 outputs where a
           joint head has 273, and the maximum is found axis by axis (action branching, Tavakoli, Pardo, Kormushev
           2018).

All weights lie in one flat vector, so that an optimiser's step and a target's update are one loop each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import Array, Integers, Policy
from stlbench_agents.engine import Network, greedy_actions
from stlbench_agents.layers import layout, size_of, views
from stlbench_agents.parameter_types import Head

__all__ = ["GreedyPolicy", "QNetwork"]

Single = NDArray[np.float32]


class QNetwork:
    """The shape of a Q-network. Holds no weights.

    Weights alternate matrices and biases: hidden layers (in, out), the last layer (outputs, in), so that the row of
    an action lies in one piece.
    """

    def __init__(self, inputs: int, net_arch: Sequence[int], grid: tuple[int, ...], head: Head) -> None:
        """Args: `inputs` D, `net_arch` hidden widths, `grid` actions an axis (their product is A)."""
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
        """The weights that lie in a flat vector, sharing its memory."""
        return views(flat, self.engine.layers)


class GreedyPolicy(Policy):
    """The greedy policy of a Q-network, with a copy of its weights."""

    def __init__(self, network: QNetwork, weights: Sequence[Single]) -> None:
        """Args: `weights` as `QNetwork.views` gives them back."""
        self.network, self.flat = network, np.concatenate([weight.ravel() for weight in weights])

    @property
    def weights(self) -> list[Single]:
        """Matrix, bias, matrix, bias, ... as `QNetwork` lays them out."""
        return self.network.views(self.flat)

    def act(self, observation: Array) -> Integers:
        """The greedy actions' indices: (N, D) -> (N,)."""
        return greedy_actions(self.flat, self.network.engine, observation)
