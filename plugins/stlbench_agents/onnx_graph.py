"""Policies as ONNX models: the parts of a graph, and the perceptrons that policies of these agents are."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from stlbench_agents.libraries import need_onnx

OPSET, _IR = 17, 8
"""Versions of ONNX of 2022, which all runtimes in use read."""
_INPUT = "observation"


def double() -> int:
    """ONNX's number of the type float64."""
    return int(need_onnx().TensorProto.DOUBLE)


class Graph:
    """A graph that is being built: each call adds a node and returns its output's name."""

    def __init__(self) -> None:
        """Raises `Unsuitable` where ONNX is not installed."""
        self._onnx = need_onnx()
        self._nodes: list[Any] = []
        self._constants: list[Any] = []

    def node(self, operator: str, *inputs: str | NDArray[Any], **attributes: Any) -> str:
        """An operator of names and of constants."""
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
        """The place (N,), counted from `begin`, of the largest of some columns; the first of equals."""
        ends = (np.array([each]) for each in (begin, end, 1))
        part = self.node("Slice", values, *ends)
        return self.node("ArgMax", part, axis=1, keepdims=0)

    def joined(self, places: list[str], sizes: Iterable[int]) -> str:
        """The index (N,) of a joint choice, of which the last part runs fastest: `np.ravel_multi_index`."""
        index, *others = places
        for place, size in zip(others, list(sizes)[1:], strict=True):
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
