"""Layers of perceptrons with ReLUs, forwards and backwards, compiled: what `dqn` and `td3` share.

All weights of a network lie in one flat vector. A network is an array of one row per layer: the offset of its matrix,
the matrix's rows and columns, the offset of its bias. Matrices of hidden layers are (inputs, outputs); the last is
(outputs, inputs), so that what belongs to one output lies in one piece. B observations are a flat vector too, row by
row. Everything works in whatever floating-point type the weights have.

No function here lets the compiler reorder sums (`fastmath`): numba compiles a function anew wherever it is used, and
whether a process compiled or loaded it decided which of the copies ran, and so the last bits of a training.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from stlbench_agents.products import inner_product, matrix, product, transposed

__all__ = ["Space", "back_hidden", "back_outputs", "hidden", "outputs", "widest"]

Floats = NDArray[Any]
Indices = NDArray[np.int64]


class Space(NamedTuple):
    """What a pass through a network writes to, made once."""

    here: Floats
    """(L - 1, B * widest): hidden activations of a pass that is followed back."""
    there: Floats
    """The same of a pass that is not."""
    back: Floats
    """(2, B * widest): gradients by activations."""
    turned: Floats
    """(widest * widest,): a matrix of weights, transposed."""

    @staticmethod
    def of(layers: Indices, rows: int, dtype: Any = np.float32) -> Space:
        """For B = `rows` and networks of this shape."""
        most = int(widest(layers))
        size, square = (len(layers) - 1, rows * most), most * most
        return Space(
            np.zeros(size, dtype), np.zeros(size, dtype), np.zeros((2, size[1]), dtype), np.zeros(square, dtype)
        )


@njit(inline="always")
def widest(layers: Indices) -> int:
    """The width of the widest layer but the inputs."""
    most = layers[-1, 1]
    for layer in range(len(layers) - 1):
        most = max(most, layers[layer, 2])
    return most


@njit(cache=True)
def hidden(flat: Floats, layers: Indices, x: Floats, rows: int, into: Floats) -> Floats:
    """The last hidden layer (B * width,) of B = `rows` inputs x; the others stay in `into`."""
    for layer in range(len(layers) - 1):
        at, inner, columns, bias = layers[layer]
        product(
            matrix(x, 0, rows, inner), matrix(flat, at, inner, columns), matrix(flat, bias, 1, columns), 0.0,
            matrix(into[layer], 0, rows, columns),
        )  # fmt: skip
        x = into[layer]
    return x


@njit(cache=True)
def outputs(flat: Floats, layers: Indices, last: Floats, rows: int, turned: Floats, into: Floats) -> None:
    """All outputs (B, outputs) of the last hidden layer (B, width), both flat; no activation after them."""
    at, count, width, bias = layers[-1]
    if count < _FEW:
        for i in range(rows):
            for j in range(count):
                total = inner_product(last, i * width, flat, at + j * width, width)
                into[i * count + j] = total + flat[bias + j]
        return
    _turn(flat, at, count, width, turned)
    product(
        matrix(last, 0, rows, width), matrix(turned, 0, width, count), matrix(flat, bias, 1, count), -np.inf,
        matrix(into, 0, rows, count),
    )  # fmt: skip


_FEW = 8
"""Below so many outputs their inner products are faster one by one."""


@njit(inline="always")
def _turn(flat: Floats, at: int, rows: int, columns: int, into: Floats) -> None:
    """Transpose the matrix at an offset."""
    for i in range(rows):
        for j in range(columns):
            into[j * rows + i] = flat[at + i * columns + j]


@njit(inline="always")
def back_outputs(
    flat: Floats, layers: Indices, last: Floats, by_output: Floats, rows: int, into: Floats, back: Floats
) -> None:
    """From the gradient by the outputs (B, outputs) to that by the last layer's weights, and by its inputs.

    The first is written to `into`, which has the layout of the weights, the second to `back` (B, width).
    """
    at, count, width, bias = layers[-1]
    given = matrix(by_output, 0, rows, count)
    nothing = matrix(flat, 0, 0, 0)
    product(transposed(given), matrix(last, 0, rows, width), nothing, -np.inf, matrix(into, at, count, width))
    _column_sums(by_output, rows, count, into, bias)
    product(given, matrix(flat, at, count, width), nothing, -np.inf, matrix(back, 0, rows, width))


@njit(inline="always")
def back_hidden(flat: Floats, layers: Indices, x: Floats, rows: int, space: Space, into: Floats) -> Floats:
    """From the gradient by the last hidden layer, in `space.back[0]`, to that by all weights below, in `into`.

    The pass forwards left its activations in `space.here`. Returns the gradient by the first layer's sums (B, width),
    from which `by_input` goes on.
    """
    nothing = matrix(flat, 0, 0, 0)
    back = space.back[0]
    for layer in range(len(layers) - 2, -1, -1):
        at, inner, columns, bias = layers[layer]
        active, below = space.here[layer], space.here[layer - 1] if layer else x
        for i in range(rows * columns):
            back[i] = back[i] if active[i] > 0 else 0
        given = matrix(back, 0, rows, columns)
        product(transposed(matrix(below, 0, rows, inner)), given, nothing, -np.inf, matrix(into, at, inner, columns))
        _column_sums(back, rows, columns, into, bias)
        if layer:
            following = space.back[(len(layers) - 1 - layer) % 2]
            _turn(flat, at, inner, columns, space.turned)
            product(given, matrix(space.turned, 0, columns, inner), nothing, -np.inf, matrix(following, 0, rows, inner))
            back = following
    return back


@njit(inline="always")
def _column_sums(values: Floats, rows: int, columns: int, into: Floats, at: int) -> None:
    """The sums over rows of a matrix, written to `into` from an offset on."""
    for j in range(columns):
        into[at + j] = 0
    for i in range(rows):
        for j in range(columns):
            into[at + j] += values[i * columns + j]
