"""The deterministic policy of an actor network, in NumPy."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionBox, Array, Arrays, Policy, Unsuitable

if TYPE_CHECKING:
    import torch

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

    def arrays(self) -> Arrays:
        """The layers, and what is between and after them."""
        layers = {
            f"{part}{i}": array
            for i, layer in enumerate(self.layers)
            for part, array in zip(("matrix", "bias"), layer, strict=True)
        }
        return {**layers, "activation": np.array(self.activation), "squashed": np.array(self.squashed)}

    def onnx(self) -> bytes:
        """One model of the layers and of what spans the box."""
        from stlbench_agents.onnx_graph import Graph, double

        graph, span = Graph(), self._high - self._low
        output = graph.perceptron(self.layers, "Tanh" if self.activation == "tanh" else "Relu")
        exact = graph.node("Cast", output, to=double())
        if self.squashed:
            share = graph.node("Mul", graph.node("Add", graph.node("Tanh", exact), np.array(1.0)), np.array(0.5))
            action = graph.node("Add", graph.node("Mul", share, span), self._low)
        else:
            action = graph.node("Min", graph.node("Max", exact, self._low), self._high)
        return graph.model(len(self.layers[0][0]), action, "action", len(span))

    @classmethod
    def of(cls, arrays: Arrays, box: ActionBox) -> ActorPolicy:
        """The policy that gave these `arrays`, for these actions. Raises `Unsuitable` for others."""
        count = sum(name.startswith("matrix") for name in arrays)
        layers = [(arrays[f"matrix{i}"], arrays[f"bias{i}"]) for i in range(count)]
        if not layers or len(layers[-1][1]) != len(box.names):
            raise Unsuitable(f"the policy is for another number of actions than {len(box.names)}")
        return cls(layers, box, "tanh" if arrays["activation"] == "tanh" else "relu", bool(arrays["squashed"]))


def linear_layers(modules: Iterable[torch.nn.Module]) -> list[Layer]:
    """The matrices (inputs, outputs) and biases of the linear layers among some modules, sharing their memory."""
    from torch.nn import Linear

    linear = [module for module in modules if isinstance(module, Linear)]
    return [(layer.weight.detach().numpy().T, layer.bias.detach().numpy()) for layer in linear]
