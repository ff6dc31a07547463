"""The policy of an actor network, in NumPy, and policies as ONNX models."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionBox, Array, Arrays, Policy, Unsuitable

if TYPE_CHECKING:
    import torch

OPSET, _IR = 17, 8  # versions of ONNX of 2022, which all runtimes in use read
_INPUT = "observation"


Head = Literal["joint", "additive"]
"""The meaning of a Q-network's outputs for actions (see `stlbench_agents.q_policy`)."""


def need(module: str, title: str, extra: str) -> None:
    """Raises `Unsuitable` if a package is not installed that the `extra` of stlbench installs."""
    if find_spec(module) is None:
        raise Unsuitable(f'it needs {title}: pip install "stlbench-rl[{extra}]"')


def _need_onnx() -> Any:
    """The package `onnx`, which is no import of this module: a cell's key does not depend on whether it is there."""
    need("onnx", "ONNX", "onnx")
    import_module("onnx.numpy_helper")
    return import_module("onnx")


def double() -> int:
    return int(_need_onnx().TensorProto.DOUBLE)


class Graph:
    """A graph that is being built: each call adds a node and returns its output's name."""

    def __init__(self) -> None:
        self._onnx = _need_onnx()
        self._nodes: list[Any] = []
        self._constants: list[Any] = []

    def node(self, operator: str, *inputs: str | NDArray[Any], **attributes: Any) -> str:
        output = f"{operator}_{len(self._nodes)}"
        names = [each if isinstance(each, str) else self._constant(each) for each in inputs]
        self._nodes.append(self._onnx.helper.make_node(operator, names, [output], **attributes))
        return output

    def _constant(self, array: NDArray[Any]) -> str:
        name = f"constant_{len(self._constants)}"
        self._constants.append(self._onnx.numpy_helper.from_array(np.ascontiguousarray(array), name))
        return name

    def perceptron(
        self, layers: Iterable[tuple[NDArray[Any], NDArray[Any]]], activation: Literal["Relu", "Tanh"]
    ) -> str:
        """Matrices (inputs, outputs) and biases, with an activation between them, of the observation."""
        last = ""
        for matrix, bias in layers:
            last = self.node("Gemm", self.node(activation, last) if last else _INPUT, matrix, bias)
        return last

    def first_largest(self, values: str, begin: int, end: int) -> str:
        ends = (np.array([each]) for each in (begin, end, 1))
        part = self.node("Slice", values, *ends)
        return self.node("ArgMax", part, axis=1, keepdims=0)

    def joined(self, places: list[str], sizes: Iterable[int]) -> str:
        """The index (N,) of a joint choice, of which the last part runs fastest: `np.ravel_multi_index`."""
        index = places[0]
        for place, size in zip(places[1:], list(sizes)[1:], strict=True):
            index = self.node("Add", self.node("Mul", index, np.array(size)), place)
        return index

    def model(self, inputs: int, output: str, name: Literal["index", "action"], axes: int = 0) -> bytes:
        """The model: `observation`, float32 (N, inputs), to `index`, int64 (N,), or `action`, float64 (N, axes)."""
        helper, kinds = self._onnx.helper, self._onnx.TensorProto
        self._nodes.append(helper.make_node("Identity", [output], [name]))
        kind = kinds.DOUBLE if name == "action" else kinds.INT64
        shape: list[str | int | None] = ["N", axes] if name == "action" else ["N"]
        given = helper.make_tensor_value_info(_INPUT, kinds.FLOAT, ["N", inputs])
        wanted = helper.make_tensor_value_info(name, kind, shape)
        graph = helper.make_graph(self._nodes, "policy", [given], [wanted], self._constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=_IR)
        self._onnx.checker.check_model(model, full_check=True)
        content: bytes = model.SerializeToString()
        return content


Single = NDArray[np.float32]
Layer = tuple[Single, Single]


class ActorPolicy(Policy):
    """Layers of a perceptron whose output is an action vector."""

    def __init__(
        self, layers: Sequence[Layer], box: ActionBox, activation: Literal["relu", "tanh"], squashed: bool
    ) -> None:
        """The layers are copied. If `squashed`, tanh of the output spans the box; else it is clipped to it."""
        self.layers = [(matrix.copy(), bias.copy()) for matrix, bias in layers]
        self.activation, self.squashed = activation, squashed
        self._low, self._high = np.array(box.low), np.array(box.high)

    def act(self, observation: Array) -> Array:
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
        layers = {
            f"{part}{i}": array
            for i, layer in enumerate(self.layers)
            for part, array in zip(("matrix", "bias"), layer, strict=True)
        }
        return {**layers, "activation": np.array(self.activation), "squashed": np.array(self.squashed)}

    def onnx(self) -> bytes:
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
