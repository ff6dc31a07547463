"""Layers of perceptrons with ReLUs, forwards and backwards, and the step along the gradient, compiled, for `dqn` and
`td3`.

All weights of a network lie in one flat vector. A network is an array of one row per layer: the offset of its matrix,
the matrix's rows and columns, the offset of its bias. Matrices of hidden layers are (inputs, outputs); the last is
(outputs, inputs), so that the weights of one output lie in one piece. B observations are a flat vector too, row by row.
Everything works in the floating-point type of the weights.

Arrays begin with a line of the processor's cache. NumPy's begin on a multiple of 16 bytes. Then most vectors of 64
bytes lie in two lines, and loops over whole arrays, such as Adam's, take longer.

One pass over the weights in blocks, since these loops wait for memory more than they compute.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench_agents.kernels import START, copy_transposed, inlined, inner_product, matrix, part, product, transposed
from stlbench_agents.plain_kernels import Floats, Indices, Matrix

_LINE = 64  # bytes of a line


def zeros(shape: int | tuple[int, ...], dtype: Any = np.float32) -> NDArray[Any]:
    """As `numpy.zeros`, row by row."""
    size = np.dtype(dtype).itemsize * int(np.prod(shape))
    memory = np.zeros(size + _LINE, np.uint8)
    begin = -memory.ctypes.data % _LINE
    array: NDArray[Any] = memory[begin : begin + size].view(dtype).reshape(shape)
    return array


def aligned(values: NDArray[Any]) -> NDArray[Any]:
    copy = zeros(values.shape, values.dtype)
    copy[...] = values
    return copy


class PassBuffers(NamedTuple):
    """Memory of passes through a network with B = `rows`."""

    forward: Floats
    """(L - 1, B * widest): hidden activations of a pass that is followed back; one row without hidden layers."""
    forward_only: Floats  # the same of a pass that is not
    backward: Floats  # (2, B * widest): gradients by activations
    transposed: Floats  # (widest * widest,): a matrix of weights
    normalised: Floats  # as `forward`: the sums of a layer with mean 0 and variance 1 over its units
    scales: Floats  # (L - 1, B): by what those were multiplied; (0, B) if the network does not normalise its sums
    ones: Floats  # (widest,)

    @staticmethod
    def of(layers: Indices, rows: int, dtype: Any = np.float32, normalised: bool = False) -> PassBuffers:
        most = _widest(layers)
        size, square = _size_of_hidden(layers, rows), most * most
        hidden = (zeros(size, dtype), zeros(size, dtype), zeros((2, size[1]), dtype), zeros(square, dtype))
        depth = len(layers) - 1 if normalised else 0
        return PassBuffers(*hidden, zeros((depth, size[1]), dtype), zeros((depth, rows), dtype), np.ones(most, dtype))


class OutputBuffers(NamedTuple):
    """Memory of the outputs at B = `rows` observations."""

    inputs: Floats  # (B * D,): the observations in the weights' type
    hidden: Floats  # (L - 1, B * widest), as `PassBuffers.forward`
    transposed: Floats  # (outputs * widest,): the last layer's weights, transposed
    outputs: Floats  # (B * outputs,)

    @staticmethod
    def of(layers: Indices, rows: int, dtype: Any = np.float32) -> OutputBuffers:
        inputs, count, most = int(layers[0, 1]), int(layers[-1, 1]), _widest(layers)
        sizes = rows * inputs, _size_of_hidden(layers, rows), count * most, rows * count
        return OutputBuffers(*(np.empty(size, dtype) for size in sizes))

    def fit(self, layers: Indices, rows: int) -> OutputBuffers:
        return self if len(self.inputs) == rows * layers[0, 1] else OutputBuffers.of(layers, rows, self.inputs.dtype)


def _widest(layers: Indices) -> int:
    """The width of the widest layer; the inputs' count only if there are no hidden layers."""
    return int(max(layers[-1, 1], *layers[:, 2]))


def _size_of_hidden(layers: Indices, rows: int) -> tuple[int, int]:
    return max(1, len(layers) - 1), rows * _widest(layers)


def layout(widths: Sequence[int], begin: int = 0) -> Indices:
    """The layers (L, 4) of a network with these widths, inputs first and outputs last, that begins at an offset."""
    layers = []
    for inputs, columns in pairwise(widths):
        bias = begin + inputs * columns
        layers.append((begin, inputs, columns, bias))
        begin = bias + columns
    at, inputs, columns, bias = layers[-1]
    layers[-1] = (at, columns, inputs, bias)
    return np.array(layers)


def size_of(layers: Indices) -> int:
    """The place at which a network ends in its vector."""
    return int(layers[-1, 3] + layers[-1, 1])


def views(flat: Floats, layers: Indices) -> list[Floats]:
    """Matrix, bias, matrix, bias, ... that lie in a flat vector, sharing its memory."""
    parts: list[Floats] = []
    for at, rows, columns, bias in layers.tolist():
        end = bias + (rows if len(parts) == 2 * len(layers) - 2 else columns)
        parts += [flat[at : at + rows * columns].reshape(rows, columns), flat[bias:end]]
    return parts


@part
def hidden(flat: Floats, layers: Indices, x: Floats, rows: int, into: Floats) -> None:
    """The hidden layers of B = `rows` inputs x, one per row of `into`; the inputs themselves if there are none."""
    if len(layers) == 1:
        for i in range(len(x)):
            into[0, i] = x[i]
    for layer in range(len(layers) - 1):
        at, inner, columns, bias = layers[layer]
        product(
            matrix(x, 0, rows, inner), matrix(flat, at, inner, columns), matrix(flat, bias, 1, columns), 0.0,
            matrix(into[layer], 0, rows, columns),
        )  # fmt: skip
        x = into[layer]


_EPSILON = 1e-5  # added to a variance, so that a layer whose sums are all equal is not divided by 0


@part
def hidden_normalised(flat: Floats, layers: Indices, x: Floats, rows: int, into: Floats, passes: PassBuffers) -> None:
    """As `hidden`, with layer normalisation (Ba, Kiros, Hinton 2016) before the bias is added.

    Units have no gain. A ReLU passes a positive factor on to the next weights, so one would add nothing.
    """
    nothing, kind = matrix(flat, 0, 0, 0), flat.dtype.type
    for layer in range(len(layers) - 1):
        at, inner, columns, bias = layers[layer]
        product(
            matrix(x, 0, rows, inner), matrix(flat, at, inner, columns), nothing, -np.inf,
            matrix(passes.normalised[layer], 0, rows, columns),
        )  # fmt: skip
        shifts = flat[bias : bias + columns]
        for i in range(rows):
            unit = slice(i * columns, (i + 1) * columns)
            sums, active = passes.normalised[layer, unit], into[layer, unit]
            mean = kind(inner_product(sums, START, passes.ones, START, columns)) / kind(columns)
            for j in range(columns):
                sums[j] -= mean
            variance = kind(inner_product(sums, START, sums, START, columns)) / kind(columns)
            scale = kind(1) / np.sqrt(variance + kind(_EPSILON))
            passes.scales[layer, i] = scale
            for j in range(columns):
                value = sums[j] * scale
                sums[j] = value
                active[j] = max(kind(0), value + shifts[j])
        x = into[layer]


@inlined
def _back_normalised(slopes: Floats, layer: int, rows: int, columns: int, passes: PassBuffers) -> None:
    """From gradients (B, columns) by normalised sums of a layer those by the sums, in place."""
    kind = slopes.dtype.type
    for i in range(rows):
        unit = slice(i * columns, (i + 1) * columns)
        slope, normal, scale = slopes[unit], passes.normalised[layer, unit], passes.scales[layer, i]
        mean = kind(inner_product(slope, START, passes.ones, START, columns)) / kind(columns)
        along = kind(inner_product(slope, START, normal, START, columns)) / kind(columns)
        for j in range(columns):
            slope[j] = (slope[j] - mean - normal[j] * along) * scale


@part
def outputs(flat: Floats, layers: Indices, last: Floats, rows: int, scratch: Floats, into: Floats) -> None:
    """All outputs (B, outputs) of the last hidden layer (B, width), both flat; no activation after them."""
    at, count, width, bias = layers[-1]
    if count < _FEW:
        for i in range(rows):
            for j in range(count):
                total = inner_product(last, i * width, flat, at + j * width, width)
                into[i * count + j] = total + flat[bias + j]
        return
    copy_transposed(flat, at, count, width, scratch)
    product(
        matrix(last, 0, rows, width), matrix(scratch, 0, width, count), matrix(flat, bias, 1, count), -np.inf,
        matrix(into, 0, rows, count),
    )  # fmt: skip


@inlined
def outputs_at(flat: Floats, layers: Indices, observation: Floats, buffers: OutputBuffers) -> None:
    """All outputs at observations (B, D) of any floating-point type, in `buffers.outputs`."""
    rows, inputs = observation.shape
    for i in range(rows):
        for j in range(inputs):
            buffers.inputs[i * inputs + j] = observation[i, j]
    hidden(flat, layers, buffers.inputs, rows, buffers.hidden)
    outputs(flat, layers, buffers.hidden[-1], rows, buffers.transposed, buffers.outputs)


_FEW = 8  # below so many outputs their inner products are faster one by one


@inlined
def back_outputs(
    flat: Floats,
    layers: Indices,
    last: Floats,
    by_output: Floats,
    rows: int,
    passes: PassBuffers,
    wanted: bool,
    into: Floats,
) -> None:
    """Compute the gradient by the last layer's inputs, in `passes.backward[0]`, from that by its outputs (B, outputs).

    If `wanted`, also write the gradient by the last layer's weights to `into`.
    """
    at, count, width, bias = layers[-1]
    given = matrix(by_output, 0, rows, count)
    nothing = matrix(flat, 0, 0, 0)
    if wanted:
        product(transposed(given), matrix(last, 0, rows, width), nothing, -np.inf, matrix(into, at, count, width))
        _column_sums(by_output, rows, count, passes.ones, into, bias)
    product(given, matrix(flat, at, count, width), nothing, -np.inf, matrix(passes.backward[0], 0, rows, width))


@inlined
def back_hidden(
    flat: Floats, layers: Indices, x: Floats, rows: int, passes: PassBuffers, wanted: bool, into: Floats
) -> Floats:
    """Compute the gradient by the first layer's sums from that by the last hidden layer, in `passes.backward[0]`.

    If `wanted`, also write the gradient by all weights below to `into`. `passes.forward` has the activations, by
    `hidden_normalised` where the passes normalise sums.
    """
    nothing, zero = matrix(flat, 0, 0, 0), flat.dtype.type(0)
    back: Floats = passes.backward[0]
    for layer in range(len(layers) - 2, -1, -1):
        at, inner, columns, bias = layers[layer]
        active, below = passes.forward[layer], passes.forward[layer - 1] if layer else x
        slopes, sums = back[: rows * columns], active[: rows * columns]  # whole arrays: else no vectors are used
        for i in range(len(slopes)):
            slope, on = slopes[i], sums[i] > zero  # both read first: a branch would be guessed wrong half of the time
            slopes[i] = slope if on else zero
        given = matrix(back, 0, rows, columns)
        if wanted:
            _column_sums(back, rows, columns, passes.ones, into, bias)
        if len(passes.scales):
            _back_normalised(back, layer, rows, columns, passes)
        if wanted:
            left, down = transposed(matrix(below, 0, rows, inner)), matrix(into, at, inner, columns)
            product(left, given, nothing, -np.inf, down)
        if layer:
            lower = passes.backward[(len(layers) - 1 - layer) % 2]
            copy_transposed(flat, at, inner, columns, passes.transposed)
            product(
                given, matrix(passes.transposed, 0, columns, inner), nothing, -np.inf, matrix(lower, 0, rows, inner)
            )
            back = lower
    return back


@inlined
def _column_sums(values: Floats, rows: int, columns: int, ones: Floats, into: Floats, at: int) -> None:
    """The sums over rows of a matrix, written to `into` from an offset on: the product with a row of ones."""
    row = Matrix(ones, 0, 1, rows, 0, 0)  # one entry again and again
    product(row, matrix(values, 0, rows, columns), matrix(ones, 0, 0, 0), -np.inf, matrix(into, at, 1, columns))


_BLOCK = 1024  # weights that Adam and the averages take at a time, so that their memory stays in the first cache


class Weights(NamedTuple):
    """The flat vectors that an update changes."""

    online: Floats
    target: Floats
    average: Floats  # the weights of the reported policy
    gradient: Floats
    mean: Floats  # Adam's first moment
    square: Floats  # Adam's second moment

    @staticmethod
    def of(flat: Floats) -> Weights:
        return Weights(*(aligned(flat) for _ in range(3)), *(zeros(flat.shape, flat.dtype) for _ in range(3)))

    def kept(self) -> Floats:
        """All but the gradient, (5, size), for `again`."""
        return np.stack([self.online, self.target, self.average, self.mean, self.square])

    @staticmethod
    def again(kept: Floats) -> Weights:
        online, target, average, mean, square = map(aligned, kept)
        return Weights(online, target, average, zeros(online.shape, online.dtype), mean, square)

    def fit(self, kept: Floats) -> bool:
        """Whether these `kept` vectors are of a network as large, in the same precision."""
        return kept.shape[1:] == self.online.shape and kept.dtype == self.online.dtype


@inlined
def clipping(gradient: Floats, max_norm: float) -> float:
    """The factor, at most 1, that brings the gradient's norm to `max_norm`."""
    total = inner_product(gradient, START, gradient, START, len(gradient))
    return float(min(1.0, max_norm / (np.sqrt(total) + 1e-6)))


@inlined
def adam(
    weights: Floats, gradient: Floats, mean: Floats, square: Floats, rate: float, count: int, factor: float
) -> None:
    """Step `count` (from 1) of Adam (Kingma, Ba 2015; betas 0.9, 0.999, epsilon 1e-8) on `factor` times the gradient.

    A weight without gradient (a dead ReLU, an action not drawn) would push its moments into denormal numbers, which
    are a hundred times slower: adding 1e-30 keeps them out.
    """
    kind = weights.dtype.type
    unbiased = np.sqrt(1 - 0.999**count)
    step, epsilon, tiny = kind(rate * unbiased / (1 - 0.9**count)), kind(1e-8 * unbiased), kind(1e-30)
    clip = kind(factor)
    for i in range(len(weights)):
        slope = gradient[i] * clip
        mean[i] = kind(0.9) * mean[i] + kind(0.1) * slope + tiny
        square[i] = kind(0.999) * square[i] + kind(0.001) * slope * slope + tiny
        weights[i] -= step * mean[i] / (np.sqrt(square[i]) + epsilon)


@inlined
def blend(into: Floats, weights: Floats, share: float) -> None:
    """into = (1 - share) into + share weights: a target network, or averaged weights, one step on; exact at 0 and 1."""
    part, rest = into.dtype.type(share), into.dtype.type(1 - share)
    for i in range(len(into)):
        into[i] = rest * into[i] + part * weights[i]


@part
def step(weights: Weights, rate: float, count: int, max_norm: float, target_share: float, average_share: float) -> None:
    """Step `count` of Adam along the gradient, its norm clipped; then target and average move by their shares."""
    factor = clipping(weights.gradient, max_norm) if max_norm < np.inf else 1.0
    for begin in range(0, len(weights.online), _BLOCK):
        now = slice(begin, begin + _BLOCK)
        online = weights.online[now]
        adam(online, weights.gradient[now], weights.mean[now], weights.square[now], rate, count, factor)
        if target_share > 0:
            blend(weights.target[now], online, target_share)
        if average_share > 0:
            blend(weights.average[now], online, average_share)
