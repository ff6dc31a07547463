"""TD3 in training, compiled: the weights of actor and critics, their updates, and actions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from stlbench.contract import ActionBox, Array, Integers
from stlbench_agents.actor_critic import Networks, Noise, TD3Buffers, actor_gradient, critic_gradient, targets
from stlbench_agents.kernels import compiled, fixed_types
from stlbench_agents.layers import OutputBuffers, outputs_at, size_of, views
from stlbench_agents.optimizer import Weights, decay, step
from stlbench_agents.plain_kernels import Floats, Indices
from stlbench_agents.policies import ActorPolicy
from stlbench_agents.replay import Batch, Memory, Replay, gather

if TYPE_CHECKING:
    from stlbench_agents.td3 import TD3


class Schedule(NamedTuple):
    rate: float
    decay: float  # of the learning rate, from one update to the next
    tau: float
    delay: int
    averaging: float
    penalty: float
    spread: float
    limit: float


class TD3Learner:
    def __init__(self, recipe: TD3, inputs: int, box: ActionBox, generator: np.random.Generator, updates: int) -> None:
        """Args: `inputs` D; `generator` of the initial weights; `updates` in all, for the learning rate."""
        self.box, self.networks = box, Networks.of(inputs, recipe.net_arch, len(box.names))
        self.actor = Weights.of(_initial(generator, self.networks.actor, last=0.1))
        self.critics = Weights.of(
            np.concatenate([_initial(generator, self.networks.critics[0], last=1.0) for _ in range(2)])
        )
        self.schedule = Schedule(
            recipe.learning_rate,
            decay(recipe.learning_rate, recipe.learning_rate_final, updates),
            recipe.tau,
            recipe.policy_delay,
            recipe.averaging,
            recipe.action_penalty,
            recipe.target_policy_noise,
            recipe.target_noise_clip,
        )
        self._scale, self._count = recipe.reward_scale, 0
        bounded = recipe.gamma < 1  # otherwise values are sums of rewards, without bounds
        self.bounds = (math.inf, -math.inf) if bounded else (-math.inf, math.inf)
        self._batch = Batch.of(recipe.batch_size, inputs, len(box.names))
        self._output_buffers = OutputBuffers.of(self.networks.actor, 1)
        self._buffers = TD3Buffers.of(self.networks, recipe.batch_size)
        self._update = fixed_types(_update)

    def compile(self) -> None:
        size, axes = int(self.networks.actor[0, 1]), len(self.box.names)
        self.act(np.zeros((1, size)), np.zeros((1, axes)))
        rows = (1, len(self._batch.returns))
        memory = Replay(2, 1, size, 1, 0.0, axes=axes).memory
        self.update(memory, np.zeros(rows, np.int64), 1, np.zeros((*rows, axes), np.float32))

    def policy(self, averaged: bool = False) -> ActorPolicy:
        parts = views(self.actor.average if averaged else self.actor.online, self.networks.actor)
        hidden = list(zip(parts[:-2:2], parts[1:-2:2], strict=True))
        return ActorPolicy([*hidden, (parts[-2].T, parts[-1])], self.box, "relu", squashed=True)

    def act(self, observation: Array, noise: Array) -> Array:
        """The actor's actions at observations (N, D) with noise (N, axes) added, within [-1, 1]: (N, axes)."""
        self._output_buffers = self._output_buffers.fit(self.networks.actor, len(observation))
        vectors = np.empty(noise.shape)
        _act(self.actor.online, self.networks.actor, observation, noise, self._output_buffers, vectors)
        return vectors

    def note_rewards(self, reward: Array) -> None:
        """Widen the bounds by rewards (N,). A value is a weighted mean of rewards, and so lies within them."""
        rewards = reward.tolist()  # of few copies: faster than NumPy's minimum and maximum
        least, most = self._scale * min(rewards), self._scale * max(rewards)
        self.bounds = min(self.bounds[0], least), max(self.bounds[1], most)

    def update(self, memory: Memory, first: Integers, copies: int, normal: Floats) -> None:
        """One update for each row of `first` (updates, B), from the transitions that begin there.

        `copies` is the distance to a copy's next transition. `normal` (updates, B, axes) is noise on target actions.
        """
        self._update(
            self.actor, self.critics, self.networks, memory, first, copies, normal, self.schedule,
            self.bounds, self._count, self._batch, self._buffers,
        )  # fmt: skip
        self._count += len(first)


def _initial(generator: np.random.Generator, layers: Indices, last: float) -> Floats:
    """Uniform in 1/sqrt(inputs), the last layer in `last` times that, biases 0."""
    flat = np.zeros(size_of(layers), np.float32)
    matrices = views(flat, layers)[::2]
    for matrix in matrices:
        final = matrix is matrices[-1]
        bound = (last if final else 1.0) / math.sqrt(matrix.shape[1 if final else 0])
        matrix[:] = generator.uniform(-bound, bound, matrix.shape)
    return flat


@compiled
def _act(
    flat: Floats, layers: Indices, observation: Floats, noise: Floats, buffers: OutputBuffers, into: Floats
) -> None:
    outputs_at(flat, layers, observation, buffers)
    rows, axes = noise.shape
    for i in range(rows):
        for j in range(axes):
            into[i, j] = min(1.0, max(-1.0, math.tanh(buffers.outputs[i * axes + j]) + noise[i, j]))


@compiled
def _update(
    actor: Weights, critics: Weights, networks: Networks, memory: Memory, first: Integers, copies: int,
    normal: Floats, schedule: Schedule, bounds: tuple[float, float], count: int, batch: Batch, buffers: TD3Buffers,
) -> None:  # fmt: skip
    """For each row of `first`, after `count` updates, a step for the critics, and every `delay` one for the actor."""
    for row in range(len(first)):
        rate = schedule.rate * schedule.decay**count
        count += 1
        acts = count % schedule.delay == 0
        tau = schedule.tau if acts else 0.0
        gather(memory, first[row], copies, batch)
        noise = Noise(normal[row], schedule.spread, schedule.limit)
        targets(actor.target, critics.target, networks, batch, noise, bounds, buffers)
        critic_gradient(critics.online, networks, batch, buffers, critics.gradient)
        step(critics, rate, count, np.inf, tau, 0.0)
        if acts:
            actor_gradient(actor.online, critics.online, networks, batch, schedule.penalty, buffers, actor.gradient)
            step(actor, rate, count // schedule.delay, np.inf, tau, 1 - schedule.averaging)
