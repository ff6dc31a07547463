"""The deterministic policy of an actor network, in NumPy."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionBox, Array, Policy

if TYPE_CHECKING:
    import torch

__all__ = ["ActorPolicy", "linear_layers"]

Single = NDArray[np.float32]
Layer = tuple[Single, Single]


class ActorPolicy(Policy):
    """Layers of a perceptron whose output is an action vector."""

    def __init__(
        self, layers: Sequence[Layer], box: ActionBox, activation: Literal["relu", "tanh"], squashed: bool
    ) -> None:
        """Args:
        layers: matrices (inputs, outputs) and biases, copied.
        box: the task's actions.
        activation: between layers.
        squashed: the output's tanh spans the box; otherwise the output is in the actions' units, and clipped.
        """
        self.layers = [(matrix.copy(), bias.copy()) for matrix, bias in layers]
        self.activation, self.squashed = activation, squashed
        self._low, self._high = np.array(box.low), np.array(box.high)

    def act(self, observation: Array) -> Array:
        """Action vectors, (N, D) -> (N, axes)."""
        x: Single = observation.astype(np.float32)
        for matrix, bias in self.layers[:-1]:
            x = x @ matrix + bias
            np.tanh(x, out=x) if self.activation == "tanh" else np.maximum(x, 0, out=x)
        matrix, bias = self.layers[-1]
        output = (x @ matrix + bias).astype(np.float64)
        if not self.squashed:
            return np.clip(output, self._low, self._high)
        vectors: Array = self._low + (np.tanh(output) + 1) / 2 * (self._high - self._low)
        return vectors


def linear_layers(modules: Iterable[torch.nn.Module]) -> list[Layer]:
    """The matrices (inputs, outputs) and biases of the linear layers among some modules, sharing their memory."""
    from torch.nn import Linear

    linear = [module for module in modules if isinstance(module, Linear)]
    return [(layer.weight.detach().numpy().T, layer.bias.detach().numpy()) for layer in linear]
