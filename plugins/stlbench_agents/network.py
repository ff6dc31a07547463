"""Q-networks: a multi-layer perceptron (ReLU) with a joint or an additive head. Trained in torch, acted with in NumPy.

joint:     one output an action, Q(s, .) in R^A.
additive:  V(s) + sum_i (A_i(s, a_i) - mean A_i(s, .)) over the axes of the action grid: 1 + 21 + 13 outputs where a
           joint head has 273, and the maximum is found axis by axis (action branching, Tavakoli, Pardo, Kormushev
           2018).

All weights live in one flat vector, so that an optimiser's step and a target's update are one operation each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.functional import embedding

from stlbench.contract import Array, Integers, Policy

__all__ = ["GreedyPolicy", "Head", "QNetwork"]

Head = Literal["joint", "additive"]
Weights = list[torch.Tensor]


class QNetwork:
    """The shape of a Q-network, and how Q is read off it. Holds no weights.

    Weights alternate matrices and biases: hidden layers (in, out), the last layer (outputs, in), so that the row of
    an action lies in one piece.
    """

    def __init__(self, inputs: int, net_arch: Sequence[int], grid: tuple[int, ...], head: Head) -> None:
        """Args: `inputs` D, `net_arch` hidden widths, `grid` actions an axis (their product is A)."""
        self.head = head
        self.axes = (math.prod(grid),) if head == "joint" else grid
        self.first = 0 if head == "joint" else 1
        hidden = [(inputs, *net_arch)[i : i + 2] for i in range(len(net_arch))]
        matrices = [*hidden, (self.first + sum(self.axes), net_arch[-1])]
        self.shapes: list[tuple[int, ...]] = []
        for i, shape in enumerate(matrices):
            self.shapes += [shape, (shape[1] if i < len(net_arch) else shape[0],)]

    def initial(self, generator: torch.Generator) -> torch.Tensor:
        """Fresh weights as one flat vector: He's normal initialisation, a small last layer, biases 0."""
        parts = []
        for i, shape in enumerate(self.shapes):
            last = i == len(self.shapes) - 2
            spread = 0.1 / math.sqrt(shape[-1]) if last else math.sqrt(2 / shape[0])
            part = torch.randn(shape, generator=generator) * spread if len(shape) == 2 else torch.zeros(shape)
            parts.append(part.ravel())
        return torch.cat(parts)

    def views(self, flat: torch.Tensor) -> Weights:
        """The weights that lie in a flat vector, sharing its memory."""
        sizes = [math.prod(shape) for shape in self.shapes]
        return [part.view(shape) for part, shape in zip(torch.split(flat, sizes), self.shapes, strict=True)]

    def hidden(self, weights: Weights, x: torch.Tensor) -> torch.Tensor:
        """The last hidden layer: x (B, D) -> (B, net_arch[-1])."""
        for i in range(0, len(weights) - 2, 2):
            x = torch.addmm(weights[i + 1], x, weights[i]).relu_()
        return x

    def value(self, weights: Weights, hidden: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        """Q(s, a): (B, net_arch[-1]), action indices (B,) -> (B,).

        A joint head is evaluated at the one row that the action needs, not at all A.
        """
        matrix, bias = weights[-2], weights[-1]
        if self.head == "joint":
            return (hidden * embedding(action, matrix)).sum(1) + bias.take(action)
        outputs = torch.addmm(bias, hidden, matrix.t())
        q = outputs[:, 0]
        for branch, index in zip(self._branches(outputs), self._along_axes(action), strict=True):
            q = q + branch.gather(1, index)[:, 0] - branch.mean(1)
        return q

    @torch.no_grad()
    def best(self, weights: Weights, hidden: torch.Tensor) -> torch.Tensor:
        """Indices of the greedy actions: (B, net_arch[-1]) -> (B,)."""
        return torch.from_numpy(self.greedy(torch.addmm(weights[-1], hidden, weights[-2].t()).numpy()))

    def greedy(self, outputs: NDArray[np.float32]) -> Integers:
        """Indices of the greedy actions: (B, outputs) -> (B,). NumPy's argmax is ten times faster than torch's."""
        action = np.zeros(len(outputs), dtype=np.int64)
        end = self.first
        for count in self.axes:
            begin, end = end, end + count
            action = action * count + outputs[:, begin:end].argmax(1)
        return action

    def _branches(self, outputs: torch.Tensor) -> tuple[torch.Tensor, ...]:
        return torch.split(outputs[:, self.first :], list(self.axes), dim=1)

    def _along_axes(self, action: torch.Tensor) -> list[torch.Tensor]:
        """The index along each axis, (B, 1) each."""
        found = []
        for count in reversed(self.axes):
            found.append((action % count)[:, None])
            action = torch.div(action, count, rounding_mode="floor")
        return found[::-1]


class GreedyPolicy(Policy):
    """A Q-network's greedy policy in NumPy: for small batches several times faster than torch."""

    def __init__(self, network: QNetwork, weights: Sequence[NDArray[np.float32]]) -> None:
        """Args: `weights` as `QNetwork` lays them out; shared, not copied (see `frozen`)."""
        self.network, self.weights = network, list(weights)

    def frozen(self) -> GreedyPolicy:
        """A copy that further training does not change."""
        return GreedyPolicy(self.network, [weight.copy() for weight in self.weights])

    def act(self, observation: Array) -> Integers:
        """The greedy actions' indices: (N, D) -> (N,)."""
        x: NDArray[np.float32] = observation.astype(np.float32)
        for i in range(0, len(self.weights) - 2, 2):
            x = x @ self.weights[i]
            x += self.weights[i + 1]
            np.maximum(x, 0, out=x)
        outputs = x @ self.weights[-2].T
        outputs += self.weights[-1]
        return self.network.greedy(outputs)
