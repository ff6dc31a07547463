"""Deep Q-learning a second time, written to be read: torch and its autograd, every action enumerated, any precision."""

from __future__ import annotations

import math
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray

from stlbench_agents.policies import Head

__all__ = ["Shape", "all_q", "gradient"]

Floats = NDArray[Any]


class Shape(NamedTuple):
    """A Q-network: D inputs, widths of the hidden layers, actions along each axis, and how they make outputs."""

    inputs: int
    net_arch: tuple[int, ...]
    grid: tuple[int, ...]
    head: Head

    @property
    def weights(self) -> list[tuple[int, ...]]:
        """Shapes of matrix, bias, matrix, bias, ... in their order in the flat vector."""
        widths = (self.inputs, *self.net_arch)
        outputs = math.prod(self.grid) if self.head == "joint" else 1 + sum(self.grid)
        hidden = [shape for a, b in pairwise(widths) for shape in ((a, b), (b,))]
        return [*hidden, (outputs, widths[-1]), (outputs,)]


def all_q(shape: Shape, flat: torch.Tensor, x: torch.Tensor) -> torch.Tensor:
    """Q of every action: x (B, D) -> (B, A), the last axis of the grid fastest."""
    parts = torch.split(flat, [math.prod(part) for part in shape.weights])
    weights = [part.view(size) for part, size in zip(parts, shape.weights, strict=True)]
    for matrix, bias in zip(weights[:-2:2], weights[1:-2:2], strict=True):
        x = torch.relu(x @ matrix + bias)
    outputs = x @ weights[-2].T + weights[-1]
    if shape.head == "joint":
        return outputs
    value, *branches = torch.split(outputs, [1, *shape.grid], dim=1)
    advantages = [branch - branch.mean(dim=1, keepdim=True) for branch in branches]
    columns = []
    for action in product(*map(range, shape.grid)):
        terms = [advantage[:, index] for advantage, index in zip(advantages, action, strict=True)]
        columns.append(value[:, 0] + torch.stack(terms).sum(dim=0))
    return torch.stack(columns, dim=1)


def gradient(
    shape: Shape, online: Floats, target: Floats, observation: Floats, action: NDArray[np.int64], returns: Floats,
    arrived: Floats, discount: Floats, double: bool,
) -> Floats:  # fmt: skip
    """Of 1/2 mean (Q(x, a) - y)^2 by the weights, y = returns + discount * Q_target(arrived, a*), in float64.

    a* is the maximiser of the online network with `double`, else of the target network.
    """
    weights, old = torch.tensor(online).double().requires_grad_(), torch.tensor(target).double()
    x, then, reward, share = (torch.tensor(part).double() for part in (observation, arrived, returns, discount))
    rows = torch.arange(len(x))
    with torch.no_grad():
        later = all_q(shape, old, then)
        chosen = (all_q(shape, weights, then) if double else later).argmax(dim=1)
        y = reward + share * later[rows, chosen]
    loss = 0.5 * ((all_q(shape, weights, x)[rows, torch.tensor(action)] - y) ** 2).mean()
    (by_weights,) = torch.autograd.grad(loss, weights)
    return by_weights.numpy()
