"""The arithmetic of TD3, compiled: targets, and the gradients of two critics and an actor; on the parts of `dqn`.

The actor's vector has one network, the critics' two of the same shape, one behind the other. Outputs of the actor pass
through tanh; actions lie in [-1, 1].
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench_agents.kernels import compiled, flattened, inner_products, part
from stlbench_agents.layers import Space, back_hidden, back_outputs, hidden, layout, outputs, size_of, zeros
from stlbench_agents.replay import Batch

Floats = NDArray[Any]
Indices = NDArray[np.int64]


class Networks(NamedTuple):
    """The shapes of actor and critics, as `stlbench_agents.layers` has them."""

    actor: Indices
    """(L, 4)."""
    critics: Indices
    """(2, L, 4): where each critic lies in the critics' vector."""

    @staticmethod
    def of(inputs: int, hidden: tuple[int, ...], axes: int) -> Networks:
        """For D = `inputs`, these widths of hidden layers, and so many axes of the action."""
        first = layout((inputs + axes, *hidden, 1))
        second = layout((inputs + axes, *hidden, 1), size_of(first))
        return Networks(layout((inputs, *hidden, axes)), np.stack([first, second]))


class Noise(NamedTuple):
    """What is added to target actions."""

    normal: Floats
    """(B, axes)."""
    spread: float
    limit: float


class Work(NamedTuple):
    """What an update of B rows writes to, made once."""

    actor: Space
    critic: Space
    joined: Floats
    """(B * (D + axes),): observations and actions side by side, the critics' inputs."""
    output: Floats
    """(B * axes,): the actor's, before the tanh."""
    value: Floats
    """(B,)."""
    goal: Floats
    """(B,): the targets."""
    by_output: Floats
    """(B * axes,): gradient by the actor's output."""

    @staticmethod
    def of(networks: Networks, rows: int, dtype: Any = np.float32) -> Work:
        """For batches of B = `rows`."""
        axes, inputs = int(networks.actor[-1, 1]), int(networks.critics[0, 0, 1])
        sizes = (rows * inputs, rows * axes, rows, rows, rows * axes)
        spaces = Space.of(networks.actor, rows, dtype), Space.of(networks.critics[0], rows, dtype)
        return Work(*spaces, *(zeros(size, dtype) for size in sizes))


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
    flat: Floats, layers: Indices, observation: Floats, activations: Floats, turned: Floats, into: Floats
) -> None:
    """The actor's output before the tanh."""
    rows = len(observation)
    hidden(flat, layers, flattened(observation), rows, activations)
    if layers[-1, 1] == 1:
        _single_output(flat, layers, activations[-1], rows, into)
    else:
        outputs(flat, layers, activations[-1], rows, turned, into)


@part
def _single_output(flat: Floats, layers: Indices, last: Floats, rows: int, into: Floats) -> None:
    """As `outputs`, where there is one, as critics have: (B,)."""
    at, _, width, bias = layers[-1]
    inner_products(last, 0, rows, width, flat, at, width, into)
    for i in range(rows):
        into[i] += flat[bias]


@compiled
def targets(
    actor: Floats, critics: Floats, networks: Networks, batch: Batch, noise: Noise, bounds: tuple[float, float],
    work: Work,
) -> None:  # fmt: skip
    """The return and, discounted, the lesser of the target critics at the noisy target action, in `work.goal`.

    Kept within `bounds`, the rewards that were seen: without that, values of states never visited run away.
    """
    rows, axes, kind = len(batch.returns), batch.action.shape[1], critics.dtype.type
    if len(work.goal) != rows:
        raise ValueError("the workspace was made for a batch of another size")
    _output(actor, networks.actor, batch.arrived, work.actor.there, work.actor.turned, work.output)
    later = work.by_output.reshape((rows, axes))  # not needed yet
    for i in range(rows):
        for j in range(axes):
            shift = min(noise.limit, max(-noise.limit, noise.spread * noise.normal[i, j]))
            later[i, j] = min(1.0, max(-1.0, math.tanh(work.output[i * axes + j]) + shift))
    _join(batch.arrived, later, work.joined)
    for which in range(2):
        layers = networks.critics[which]
        hidden(critics, layers, work.joined, rows, work.critic.there)
        _single_output(critics, layers, work.critic.there[-1], rows, work.value)
        for i in range(rows):
            work.goal[i] = work.value[i] if which == 0 else min(work.goal[i], work.value[i])
    for i in range(rows):
        goal = batch.returns[i] + batch.discount[i] * work.goal[i]
        work.goal[i] = min(kind(bounds[1]), max(kind(bounds[0]), goal))


@compiled
def critic_gradient(critics: Floats, networks: Networks, batch: Batch, work: Work, into: Floats) -> None:
    """The gradient of Huber's loss of both critics, the sum of their means over the batch, by `work.goal`."""
    rows, kind = len(batch.returns), critics.dtype.type
    _join(batch.observation, batch.action, work.joined)
    for which in range(2):
        layers = networks.critics[which]
        hidden(critics, layers, work.joined, rows, work.critic.here)
        last = work.critic.here[-1]
        _single_output(critics, layers, last, rows, work.value)
        for i in range(rows):
            error = work.value[i] - work.goal[i]
            work.value[i] = min(kind(1), max(kind(-1), error)) / kind(rows)
        back_outputs(critics, layers, last, work.value, rows, work.critic, True, into)
        back_hidden(critics, layers, work.joined, rows, work.critic, True, into)


@compiled
def actor_gradient(
    actor: Floats, critics: Floats, networks: Networks, batch: Batch, penalty: float, work: Work, into: Floats
) -> None:
    """The gradient of the mean of penalty * output^2 less that of the first critic's value of the actor's action."""
    rows, axes, inputs = len(batch.returns), batch.action.shape[1], batch.observation.shape[1]
    layers, kind = networks.critics[0], actor.dtype.type
    _output(actor, networks.actor, batch.observation, work.actor.here, work.actor.turned, work.output)
    for i in range(rows * axes):
        work.by_output[i] = math.tanh(work.output[i])
    _join(batch.observation, work.by_output.reshape((rows, axes)), work.joined)
    hidden(critics, layers, work.joined, rows, work.critic.here)
    for i in range(rows):
        work.value[i] = kind(-1) / kind(rows)
    back_outputs(critics, layers, work.critic.here[-1], work.value, rows, work.critic, False, into)
    back = back_hidden(critics, layers, work.joined, rows, work.critic, False, into)
    width, share = layers[0, 2], kind(2 * penalty / (rows * axes))
    for j in range(axes):
        inner_products(back, 0, rows, width, critics, layers[0, 0] + (inputs + j) * width, width, work.value)
        for i in range(rows):
            at = i * axes + j
            action = work.by_output[at]
            work.by_output[at] = work.value[i] * (kind(1) - action * action) + share * work.output[at]
    x = flattened(batch.observation)
    back_outputs(actor, networks.actor, work.actor.here[-1], work.by_output, rows, work.actor, True, into)
    back_hidden(actor, networks.actor, x, rows, work.actor, True, into)
