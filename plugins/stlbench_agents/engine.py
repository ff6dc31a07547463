"""The arithmetic of deep Q-learning, compiled by numba: acting, and the gradient of the loss.

No framework is used: at these sizes (batch 128, layers of 64 to 128) dispatch, bookkeeping and unfused elementwise work
cost more than the matrix products; docs/performance.md compares. Everything works in place on weights that lie in one
flat vector, as `stlbench_agents.layers` says. The tests check the gradient against torch's autograd.

`axes` counts the actions along each axis of the grid. In an additive network the first output is V and
Q = V + sum_i (A_i(a_i) - mean A_i). Any other has one axis of all the actions, and Q = A_1(a).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from stlbench_agents.kernels import START, compiled, flattened, inlined, inner_product, part
from stlbench_agents.layers import (
    OutputBuffers,
    PassBuffers,
    back_hidden,
    back_outputs,
    hidden,
    outputs,
    outputs_at,
    zeros,
)
from stlbench_agents.plain_kernels import Floats, Indices
from stlbench_agents.replay import Batch, bounded_target


class Network(NamedTuple):
    layers: Indices  # (L, 4): offset of the matrix, rows, columns, offset of the bias
    axes: Indices  # actions along each axis
    additive: bool  # whether there is an output V, and the mean of each axis is taken off


class QBuffers(NamedTuple):
    """Memory of updates with B rows."""

    passes: PassBuffers
    outputs: Floats  # (B * outputs,)
    ones: Floats  # (outputs,), all 1: an inner product with them is a sum
    chosen: Indices  # (B,): the actions to bootstrap from
    goal: Floats  # (B,): the targets

    @staticmethod
    def of(network: Network, batch: int, dtype: Any = np.float32) -> QBuffers:
        count = int(network.layers[-1, 1])
        return QBuffers(
            PassBuffers.of(network.layers, batch, dtype),
            zeros(batch * count, dtype),
            np.ones(count, dtype),
            zeros(batch, np.int64),
            zeros(batch, dtype),
        )


@part
def _greedy(values: Floats, begin: int, network: Network) -> int:
    """The action of the largest Q, the first of equals, of a row of outputs that begins there."""
    action = 0
    begin += 1 if network.additive else 0
    for count in network.axes:
        first = 0
        for j in range(1, count):
            if values[begin + j] > values[begin + first]:
                first = j
        action = action * count + first
        begin += count
    return action


@inlined
def _additive(values: Floats, begin: int, action: int, axes: Indices, ones: Floats) -> Any:
    """V + sum_i (A_i(a_i) - mean A_i) of a row of outputs that begins there."""
    q, at, rest = values[begin], begin + len(ones), action
    for i in range(len(axes) - 1, -1, -1):
        at -= axes[i]
        q += values[at + rest % axes[i]] - inner_product(values, at, ones, START, axes[i]) / values.dtype.type(axes[i])
        rest //= axes[i]
    return q


@inlined
def _single(flat: Floats, layers: Indices, last: Floats, row: int, action: int) -> Any:
    """Q of one action of a joint head: one row of the last layer is all it needs."""
    at, _, width, bias = layers[-1]
    return inner_product(last, row * width, flat, at + action * width, width) + flat[bias + action]


@compiled
def actions(
    flat: Floats, network: Network, observation: Floats, epsilon: float, chance: Floats, count: int,
    buffers: OutputBuffers, into: Indices,
) -> None:  # fmt: skip
    """Epsilon-greedy actions at observations (B, D): `into` (B,), of equals the first; `chance` (2, B) in [0, 1)."""
    outputs_at(flat, network.layers, observation, buffers)
    for i in range(len(observation)):
        into[i] = _greedy(buffers.outputs, i * network.layers[-1, 1], network)
        if epsilon > 0 and chance[0, i] < epsilon:
            into[i] = int(chance[1, i] * count)


def greedy_actions(flat: Floats, network: Network, observation: Floats) -> Indices:
    """Greedy actions at observations (B, D) of any floating-point type: (B,). The first of equals."""
    rows = len(observation)
    chosen, buffers = np.empty(rows, np.int64), OutputBuffers.of(network.layers, rows, flat.dtype)
    actions(flat, network, np.ascontiguousarray(observation), 0.0, _NO_CHANCE, 1, buffers, chosen)
    return chosen


_NO_CHANCE = np.empty((2, 0))  # nothing is read of it, as epsilon is 0


@inlined
def joint_gradient(
    online: Floats, target: Floats, network: Network, batch: Batch, double: bool, buffers: QBuffers, into: Floats
) -> None:
    """The gradient of sum_i (Q(x_i, a_i) - y_i)^2 / 2B, y = returns + discount * Q_target(arrived, best): in `into`.

    The best action is the online network's with `double`, else the target network's.
    """
    layers, rows, passes = network.layers, len(batch.returns), buffers.passes
    _look_ahead(online, target, network, batch, double, buffers)
    later = passes.forward_only[-1]
    if not double:
        outputs(target, layers, later, rows, passes.transposed, buffers.outputs)
    for i in range(rows):
        if double:
            value = _single(target, layers, later, i, buffers.chosen[i])
        else:
            value = buffers.outputs[i * layers[-1, 1] + _greedy(buffers.outputs, i * layers[-1, 1], network)]
        buffers.goal[i] = bounded_target(batch, i, value)
    x = flattened(batch.observation)
    hidden(online, layers, x, rows, passes.forward)
    _back_joint(online, layers, passes.forward[-1], batch.action, rows, buffers, into)
    back_hidden(online, layers, x, rows, passes, True, into)


@inlined
def additive_gradient(
    online: Floats, target: Floats, network: Network, batch: Batch, double: bool, buffers: QBuffers, into: Floats
) -> None:
    """The same for an additive head."""
    layers, rows, passes = network.layers, len(batch.returns), buffers.passes
    _look_ahead(online, target, network, batch, double, buffers)
    outputs(target, layers, passes.forward_only[-1], rows, passes.transposed, buffers.outputs)
    for i in range(rows):
        begin = i * layers[-1, 1]
        chosen = buffers.chosen[i] if double else _greedy(buffers.outputs, begin, network)
        value = _additive(buffers.outputs, begin, chosen, network.axes, buffers.ones)
        buffers.goal[i] = bounded_target(batch, i, value)
    x = flattened(batch.observation)
    hidden(online, layers, x, rows, passes.forward)
    _back_additive(online, network, passes.forward[-1], batch.action, rows, buffers, into)
    back_hidden(online, layers, x, rows, passes, True, into)


@inlined
def _look_ahead(
    online: Floats, target: Floats, network: Network, batch: Batch, double: bool, buffers: QBuffers
) -> None:
    """The target network's hidden layers where transitions arrived; with `double` also the best actions there.

    Both networks share the memory of activations, so the online network, whose outputs count here, comes first.
    """
    rows, passes = len(batch.returns), buffers.passes
    if len(buffers.goal) != rows:
        raise ValueError("the workspace was made for a batch of another size")
    there = flattened(batch.arrived)
    if double:
        hidden(online, network.layers, there, rows, passes.forward_only)
        outputs(online, network.layers, passes.forward_only[-1], rows, passes.transposed, buffers.outputs)
        for i in range(rows):
            buffers.chosen[i] = _greedy(buffers.outputs, i * network.layers[-1, 1], network)
    hidden(target, network.layers, there, rows, passes.forward_only)


@inlined
def _back_joint(
    flat: Floats, layers: Indices, last: Floats, action: Indices, rows: int, buffers: QBuffers, into: Floats
) -> None:
    """The last layer of a joint head: only the rows of the B actions taken have a gradient."""
    at, count, width, bias = layers[-1]
    back = buffers.passes.backward[0]
    into[at : at + count * width] = 0
    into[bias : bias + count] = 0
    for i in range(rows):
        error = (_single(flat, layers, last, i, action[i]) - buffers.goal[i]) / flat.dtype.type(rows)
        into[bias + action[i]] += error
        begin, row = i * width, at + action[i] * width
        for j in range(width):
            into[row + j] += error * last[begin + j]
        for j in range(width):
            back[begin + j] = error * flat[row + j]


@inlined
def _back_additive(
    flat: Floats, network: Network, last: Floats, action: Indices, rows: int, buffers: QBuffers, into: Floats
) -> None:
    """The last layer of an additive head; `buffers.outputs` ends as the gradient by the outputs."""
    layers, axes, values = network.layers, network.axes, buffers.outputs
    count = layers[-1, 1]
    outputs(flat, layers, last, rows, buffers.passes.transposed, values)
    for i in range(rows):
        begin = i * count
        q = _additive(values, begin, action[i], axes, buffers.ones)
        error = (q - buffers.goal[i]) / flat.dtype.type(rows)
        values[begin] = error
        at, rest = begin + count, action[i]
        for axis in range(len(axes) - 1, -1, -1):
            at -= axes[axis]
            share = -error / flat.dtype.type(axes[axis])  # the mean is taken off, so each output has a gradient
            for j in range(axes[axis]):
                values[at + j] = share
            values[at + rest % axes[axis]] += error
            rest //= axes[axis]
    back_outputs(flat, layers, last, values, rows, buffers.passes, True, into)
