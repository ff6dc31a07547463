"""The arithmetic of TD3, compiled: targets, and the gradients of two critics and an actor; on the parts of `dqn`.

The actor's vector has one network, the critics' two of the same shape, one behind the other. Outputs of the actor pass
through tanh; actions lie in [-1, 1].
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from stlbench_agents.kernels import compiled, flattened, inner_products, part
from stlbench_agents.layers import PassBuffers, back_hidden, back_outputs, hidden, layout, outputs, size_of, zeros
from stlbench_agents.plain_kernels import Floats, Indices
from stlbench_agents.replay import Batch, bounded_target


class Networks(NamedTuple):
    """The shapes of actor and critics, as `stlbench_agents.layers` has them."""

    actor: Indices  # (L, 4)
    critics: Indices  # (2, L, 4): where each critic lies in the critics' vector

    @staticmethod
    def of(inputs: int, hidden: tuple[int, ...], axes: int) -> Networks:
        """For D = `inputs`, these widths of hidden layers, and so many axes of the action."""
        first = layout((inputs + axes, *hidden, 1))
        second = layout((inputs + axes, *hidden, 1), size_of(first))
        return Networks(layout((inputs, *hidden, axes)), np.stack([first, second]))


class Noise(NamedTuple):
    normal: Floats  # (B, axes)
    spread: float
    limit: float


class TD3Buffers(NamedTuple):
    """Memory of updates with B rows."""

    actor: PassBuffers
    critic: PassBuffers
    joined: Floats  # (B * (D + axes),): observations and actions side by side, the critics' inputs
    output: Floats  # (B * axes,): the actor's, before the tanh
    value: Floats  # (B,)
    goal: Floats  # (B,): the targets
    by_output: Floats  # (B * axes,): gradient by the actor's output

    @staticmethod
    def of(networks: Networks, rows: int, dtype: Any = np.float32) -> TD3Buffers:
        axes, inputs = int(networks.actor[-1, 1]), int(networks.critics[0, 0, 1])
        sizes = (rows * inputs, rows * axes, rows, rows, rows * axes)
        spaces = PassBuffers.of(networks.actor, rows, dtype), PassBuffers.of(networks.critics[0], rows, dtype)
        return TD3Buffers(*spaces, *(zeros(size, dtype) for size in sizes))


@part
def _join(observation: Floats, action: Floats, into: Floats) -> None:
    """Observations (B, D) and actions (B, axes) side by side."""
    rows, inputs, axes = len(observation), observation.shape[1], action.shape[1]
    for i in range(rows):
        begin = i * (inputs + axes)
        for j in range(inputs):
            into[begin + j] = observation[i, j]
        for j in range(axes):
            into[begin + inputs + j] = action[i, j]


@part
def _output(
    flat: Floats, layers: Indices, observation: Floats, activations: Floats, scratch: Floats, into: Floats
) -> None:
    """The actor's output before the tanh."""
    rows = len(observation)
    hidden(flat, layers, flattened(observation), rows, activations)
    if layers[-1, 1] == 1:
        _single_output(flat, layers, activations[-1], rows, into)
    else:
        outputs(flat, layers, activations[-1], rows, scratch, into)


@part
def _single_output(flat: Floats, layers: Indices, last: Floats, rows: int, into: Floats) -> None:
    """As `outputs`, where there is one, as critics have: (B,)."""
    at, _, width, bias = layers[-1]
    inner_products(last, 0, rows, width, flat, at, width, into)
    for i in range(rows):
        into[i] += flat[bias]


@compiled
def targets(
    actor: Floats, critics: Floats, networks: Networks, batch: Batch, noise: Noise, buffers: TD3Buffers
) -> None:  # fmt: skip
    """The return and, discounted, the lesser of the target critics at the noisy target action, in `buffers.goal`."""
    rows, axes = len(batch.returns), batch.action.shape[1]
    if len(buffers.goal) != rows:
        raise ValueError("the workspace was made for a batch of another size")
    _output(actor, networks.actor, batch.arrived, buffers.actor.forward_only, buffers.actor.transposed, buffers.output)
    later = buffers.by_output.reshape((rows, axes))  # not needed yet
    for i in range(rows):
        for j in range(axes):
            shift = min(noise.limit, max(-noise.limit, noise.spread * noise.normal[i, j]))
            later[i, j] = min(1.0, max(-1.0, math.tanh(buffers.output[i * axes + j]) + shift))
    _join(batch.arrived, later, buffers.joined)
    for which in range(2):
        layers = networks.critics[which]
        hidden(critics, layers, buffers.joined, rows, buffers.critic.forward_only)
        _single_output(critics, layers, buffers.critic.forward_only[-1], rows, buffers.value)
        for i in range(rows):
            buffers.goal[i] = buffers.value[i] if which == 0 else min(buffers.goal[i], buffers.value[i])
    for i in range(rows):
        buffers.goal[i] = bounded_target(batch, i, buffers.goal[i])


@compiled
def critic_gradient(critics: Floats, networks: Networks, batch: Batch, buffers: TD3Buffers, into: Floats) -> None:
    """The gradient of Huber's loss of both critics, the sum of their means over the batch, by `buffers.goal`."""
    rows, kind = len(batch.returns), critics.dtype.type
    _join(batch.observation, batch.action, buffers.joined)
    for which in range(2):
        layers = networks.critics[which]
        hidden(critics, layers, buffers.joined, rows, buffers.critic.forward)
        last = buffers.critic.forward[-1]
        _single_output(critics, layers, last, rows, buffers.value)
        for i in range(rows):
            error = buffers.value[i] - buffers.goal[i]
            buffers.value[i] = min(kind(1), max(kind(-1), error)) / kind(rows)
        back_outputs(critics, layers, last, buffers.value, rows, buffers.critic, True, into)
        back_hidden(critics, layers, buffers.joined, rows, buffers.critic, True, into)


@compiled
def actor_gradient(
    actor: Floats,
    critics: Floats,
    networks: Networks,
    batch: Batch,
    penalty: float,
    buffers: TD3Buffers,
    into: Floats,
) -> None:
    """The gradient of the mean of penalty * output^2 less that of the first critic's value of the actor's action."""
    rows, axes, inputs = len(batch.returns), batch.action.shape[1], batch.observation.shape[1]
    layers, kind = networks.critics[0], actor.dtype.type
    _output(actor, networks.actor, batch.observation, buffers.actor.forward, buffers.actor.transposed, buffers.output)
    for i in range(rows * axes):
        buffers.by_output[i] = math.tanh(buffers.output[i])
    _join(batch.observation, buffers.by_output.reshape((rows, axes)), buffers.joined)
    hidden(critics, layers, buffers.joined, rows, buffers.critic.forward)
    for i in range(rows):
        buffers.value[i] = kind(-1) / kind(rows)
    back_outputs(critics, layers, buffers.critic.forward[-1], buffers.value, rows, buffers.critic, False, into)
    back = back_hidden(critics, layers, buffers.joined, rows, buffers.critic, False, into)
    width, share = layers[0, 2], kind(2 * penalty / (rows * axes))
    for j in range(axes):
        inner_products(back, 0, rows, width, critics, layers[0, 0] + (inputs + j) * width, width, buffers.value)
        for i in range(rows):
            at = i * axes + j
            action = buffers.by_output[at]
            buffers.by_output[at] = buffers.value[i] * (kind(1) - action * action) + share * buffers.output[at]
    x = flattened(batch.observation)
    back_outputs(actor, networks.actor, buffers.actor.forward[-1], buffers.by_output, rows, buffers.actor, True, into)
    back_hidden(actor, networks.actor, x, rows, buffers.actor, True, into)
