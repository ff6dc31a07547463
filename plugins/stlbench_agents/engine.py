"""The arithmetic of deep Q-learning, compiled by numba: acting, and the gradient of the loss.

Why not a framework: at these sizes (batch 128, layers of 64 to 128) an update is 150 microseconds of matrix products,
and dispatch, bookkeeping and unfused elementwise work cost more than that again; docs/performance.md compares. Here
matrix products go to BLAS, but for the few inputs of the first layer, and the loops in between are fused. Everything
works in place on weights that lie in one flat vector, in whatever floating-point type that has: the tests check the
gradient against torch's autograd in double precision.

Layers lie in the flat vector as `layers` says, a row a layer: (offset of the matrix, rows, columns, offset of the
bias). Hidden matrices are (inputs, outputs); the last one is (outputs, inputs), so that the row of an action lies in
one piece. `axes` counts the actions along each axis of the grid. With `additive` the first output is V and
Q = V + sum_i (A_i(a_i) - mean A_i); without, there is one axis of all the actions and Q = A_1(a).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

__all__ = ["Network", "Workspace", "best_actions", "gradient"]

Floats = NDArray[Any]
Indices = NDArray[np.int64]

_THIN = 16
"""Up to so many inputs the gradient by the first matrix is faster as a loop than by BLAS."""


class Network(NamedTuple):
    """The shape of a Q-network."""

    layers: Indices
    """(L, 4): offset of the matrix, rows, columns, offset of the bias."""
    axes: Indices
    """Actions along each axis."""
    additive: bool
    """Whether there is an output V, and the mean of each axis is taken off."""


class Workspace(NamedTuple):
    """What an update of B rows writes to, made once."""

    here: Floats
    """(L - 1, B * widest): hidden activations at the observations."""
    there: Floats
    """The same at what the transitions arrived at."""
    back: Floats
    """(2, B * widest): gradients by activations."""
    outputs: Floats
    """(B, outputs)."""
    chosen: Indices
    """(B,): the actions to bootstrap from."""

    @staticmethod
    def of(network: Network, batch: int, dtype: Any = np.float32) -> Workspace:
        """A workspace for batches of `batch` rows."""
        layers = network.layers
        size = (len(layers) - 1, batch * int(layers[:-1, 2].max()))
        hidden = (np.zeros(size, dtype), np.zeros(size, dtype), np.zeros((2, size[1]), dtype))
        return Workspace(*hidden, np.zeros((batch, int(layers[-1, 1])), dtype), np.zeros(batch, np.int64))


@njit(cache=True)
def _matrix(flat: Floats, layer: Indices) -> Floats:
    return flat[layer[0] : layer[0] + layer[1] * layer[2]].reshape((layer[1], layer[2]))


@njit(cache=True)
def _rows(store: Floats, rows: int, columns: int) -> Floats:
    return store[: rows * columns].reshape((rows, columns))


@njit(cache=True, fastmath=True)
def _hidden(flat: Floats, layers: Indices, x: Floats, into: Floats) -> Floats:
    """The last hidden layer (B, width); the others stay in `into`."""
    for layer in range(len(layers) - 1):
        columns, bias = layers[layer, 2], flat[layers[layer, 3] :]
        out = _rows(into[layer], len(x), columns)
        np.dot(x, _matrix(flat, layers[layer]), out)
        for i in range(len(x)):
            for j in range(columns):
                out[i, j] = max(out[i, j] + bias[j], flat.dtype.type(0))
        x = out
    return x


@njit(cache=True, fastmath=True)
def _outputs(flat: Floats, layers: Indices, hidden: Floats, into: Floats) -> None:
    """All outputs (B, outputs)."""
    np.dot(hidden, _matrix(flat, layers[-1]).T, into)
    bias = flat[layers[-1, 3] :]
    for i in range(into.shape[0]):
        for j in range(into.shape[1]):
            into[i, j] += bias[j]


@njit(cache=True, fastmath=True)
def _max(row: Floats) -> Any:
    best = row[0]
    for j in range(1, len(row)):
        best = max(best, row[j])
    return best


@njit(cache=True)
def _greedy(row: Floats, network: Network) -> int:
    """The action of the largest Q, the first of equals, of a row of outputs."""
    action, begin = 0, 1 if network.additive else 0
    for count in network.axes:
        best, first = _max(row[begin : begin + count]), 0
        while first < count - 1 and row[begin + first] != best:
            first += 1
        action = action * count + first
        begin += count
    return action


@njit(cache=True, fastmath=True, error_model="numpy")
def _additive(row: Floats, action: int, axes: Indices) -> Any:
    """V + sum_i (A_i(a_i) - mean A_i) of a row of outputs."""
    q, begin, rest = row[0], len(row), action
    for i in range(len(axes) - 1, -1, -1):
        begin -= axes[i]
        total = row.dtype.type(0)
        for j in range(begin, begin + axes[i]):  # not .mean(), which would not be vectorised
            total += row[j]
        q += row[begin + rest % axes[i]] - total / row.dtype.type(axes[i])
        rest //= axes[i]
    return q


@njit(cache=True, fastmath=True)
def _single(flat: Floats, layers: Indices, hidden: Floats, action: int) -> Any:
    """Q of one action of a joint head: one row of the last layer is all it needs."""
    row, q = _matrix(flat, layers[-1])[action], flat[layers[-1, 3] + action]
    for j in range(len(hidden)):  # a BLAS dot product would take as long as ten of these
        q += hidden[j] * row[j]
    return q


@njit(cache=True)
def best_actions(flat: Floats, network: Network, observation: Floats) -> Indices:
    """Greedy actions at observations (B, D) of any floating-point type: (B,). Of equals the first."""
    size, layers, widest = len(observation), network.layers, 0
    for layer in range(len(layers) - 1):
        widest = max(widest, layers[layer, 2])
    x = np.empty((size, observation.shape[1]), flat.dtype)
    for i in range(size):
        for j in range(observation.shape[1]):
            x[i, j] = observation[i, j]
    hidden = np.empty((len(layers) - 1, size * widest), flat.dtype)
    outputs = np.empty((size, layers[-1, 1]), flat.dtype)
    chosen = np.empty(size, np.int64)
    _choose(flat, network, x, hidden, outputs, chosen)
    return chosen


@njit(cache=True)
def _choose(flat: Floats, network: Network, x: Floats, hidden: Floats, outputs: Floats, into: Indices) -> None:
    _outputs(flat, network.layers, _hidden(flat, network.layers, x, hidden), outputs)
    for i in range(len(x)):
        into[i] = _greedy(outputs[i], network)


@njit(cache=True, fastmath=True)
def gradient(
    online: Floats, target: Floats, network: Network, observation: Floats, action: Indices, returns: Floats,
    arrived: Floats, discount: Floats, double: bool, space: Workspace, into: Floats,
) -> None:  # fmt: skip
    """The gradient of sum_i (Q(x_i, a_i) - y_i)^2 / 2B with y = returns + discount * Q_target(arrived, best).

    It is written to `into`, which has the layout of the weights. The best action is the online network's with
    `double`, else the target network's.
    """
    layers, size = network.layers, len(observation)
    if double:
        _choose(online, network, arrived, space.there, space.outputs, space.chosen)
    later, goal = _hidden(target, layers, arrived, space.there), np.empty_like(returns)
    if network.additive or not double:
        _outputs(target, layers, later, space.outputs)
    for i in range(size):
        if network.additive:
            action_there = space.chosen[i] if double else _greedy(space.outputs[i], network)
            value = _additive(space.outputs[i], action_there, network.axes)
        elif double:
            value = _single(target, layers, later[i], space.chosen[i])
        else:
            value = _max(space.outputs[i])
        goal[i] = returns[i] + discount[i] * value
    hidden = _hidden(online, layers, observation, space.here)
    back = _rows(space.back[0], size, layers[-1, 2])
    if network.additive:
        _back_additive(online, network, hidden, action, goal, space.outputs, back, into)
    else:
        _back_joint(online, layers, hidden, action, goal, back, into)
    _back_hidden(online, layers, observation, space, into)


@njit(cache=True, fastmath=True, error_model="numpy")
def _back_joint(
    flat: Floats, layers: Indices, hidden: Floats, action: Indices, goal: Floats, back: Floats, into: Floats
) -> None:
    """The last layer of a joint head: only the rows of the B actions taken have a gradient."""
    matrix, bias = _matrix(flat, layers[-1]), layers[-1, 3]
    by_matrix = _matrix(into, layers[-1])
    by_matrix[:] = 0
    into[bias : bias + len(matrix)] = 0
    for i in range(len(action)):
        row, q = action[i], flat[bias + action[i]]
        for j in range(hidden.shape[1]):  # three loops: one alone would not be vectorised
            q += hidden[i, j] * matrix[row, j]
        error = (q - goal[i]) / flat.dtype.type(len(action))
        into[bias + row] += error
        for j in range(hidden.shape[1]):
            by_matrix[row, j] += error * hidden[i, j]
        for j in range(hidden.shape[1]):
            back[i, j] = error * matrix[row, j]


@njit(cache=True, fastmath=True, error_model="numpy")
def _back_additive(
    flat: Floats, network: Network, hidden: Floats, action: Indices, goal: Floats, outputs: Floats, back: Floats,
    into: Floats,
) -> None:  # fmt: skip
    """The last layer of an additive head; `outputs` ends as the gradient by the outputs."""
    layers, axes = network.layers, network.axes
    _outputs(flat, layers, hidden, outputs)
    for i in range(len(action)):
        error = (_additive(outputs[i], action[i], axes) - goal[i]) / flat.dtype.type(len(action))
        outputs[i, 0] = error
        begin, rest = outputs.shape[1], action[i]
        for axis in range(len(axes) - 1, -1, -1):
            begin -= axes[axis]
            outputs[i, begin : begin + axes[axis]] = -error / flat.dtype.type(axes[axis])
            outputs[i, begin + rest % axes[axis]] += error
            rest //= axes[axis]
    np.dot(outputs.T, hidden, _matrix(into, layers[-1]))
    _column_sums(outputs, into[layers[-1, 3] :])
    np.dot(outputs, _matrix(flat, layers[-1]), back)


@njit(cache=True, fastmath=True)
def _back_hidden(flat: Floats, layers: Indices, x: Floats, space: Workspace, into: Floats) -> None:
    """The hidden layers, last first; the gradient by the last one's activations is in `space.back[0]`."""
    size, now = len(x), 0
    for layer in range(len(layers) - 2, -1, -1):
        rows, columns = layers[layer, 1], layers[layer, 2]
        back, active = _rows(space.back[now], size, columns), _rows(space.here[layer], size, columns)
        by_matrix, by_bias = _matrix(into, layers[layer]), into[layers[layer, 3] :]
        by_bias[:columns] = 0
        for i in range(size):
            for j in range(columns):
                back[i, j] = back[i, j] if active[i, j] > 0 else flat.dtype.type(0)
            for j in range(columns):
                by_bias[j] += back[i, j]
        below = _rows(space.here[layer - 1], size, rows) if layer else x
        if rows > _THIN:
            np.dot(below.T, back, by_matrix)
        else:
            _thin(below, back, by_matrix)
        if layer:
            now = 1 - now
            np.dot(back, _matrix(flat, layers[layer]).T, _rows(space.back[now], size, rows))


@njit(cache=True, fastmath=True)
def _thin(x: Floats, back: Floats, into: Floats) -> None:
    """into = x.T back, for few columns of x."""
    into[:] = 0
    for i in range(x.shape[0]):
        for k in range(x.shape[1]):
            share = x[i, k]
            for j in range(back.shape[1]):
                into[k, j] += share * back[i, j]


@njit(cache=True, fastmath=True)
def _column_sums(values: Floats, into: Floats) -> None:
    into[: values.shape[1]] = 0
    for i in range(values.shape[0]):
        for j in range(values.shape[1]):
            into[j] += values[i, j]
