"""TD3 in training, compiled: the weights of actor and critics, their updates, and actions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from stlbench.contract import ActionBox, Array, Integers, Transition, Unsuitable
from stlbench_agents.actor_critic import Networks, Noise, TD3Buffers, actor_gradient, critic_gradient, targets
from stlbench_agents.kernels import compiled, fixed_types
from stlbench_agents.layers import OutputBuffers, outputs_at, size_of, views
from stlbench_agents.optimizer import Weights, decay, step
from stlbench_agents.plain_kernels import Floats, Indices
from stlbench_agents.policies import ActorPolicy
from stlbench_agents.replay import Batch, Memory, Replay, gather
from stlbench_agents.training import refuse_other, resumed_rate

if TYPE_CHECKING:
    from stlbench_agents.td3 import TD3


_STILL = 0.1
"""The share of a training from an earlier policy in which its actor rests."""


class Schedule(NamedTuple):
    rate: float
    decay: float  # of the learning rate, from one update to the next
    tau: float
    delay: int
    averaging: float
    penalty: float
    spread: float
    limit: float
    still: int  # updates before the first of the actor, a multiple of `delay`


class TD3Learner:
    def __init__(self, recipe: TD3, inputs: int, box: ActionBox, copies: int, seed: int, rounds: int) -> None:
        """Args: `inputs` D; `copies` in lock-step; `rounds`, their steps in all, for what changes over the training."""
        axes = len(box.names)
        self.recipe, self.box, self.networks = recipe, box, Networks.of(inputs, recipe.net_arch, axes)
        self._low: Array = np.array(box.low)
        self._span: Array = np.array(box.high) - self._low
        self._generator = np.random.default_rng(seed)
        self.actor = Weights.of(self._initial(self.networks.actor, last=0.1))
        self.critics = Weights.of(np.concatenate([self._initial(self.networks.critics[0], last=1.0) for _ in range(2)]))
        updates = (rounds - recipe.random_steps) * recipe.gradient_steps
        self.schedule = Schedule(
            recipe.learning_rate,
            decay(recipe.learning_rate, recipe.learning_rate_final, updates),
            recipe.tau,
            recipe.policy_delay,
            recipe.averaging,
            recipe.action_penalty,
            recipe.target_policy_noise,
            recipe.target_noise_clip,
            0,
        )
        rows = max(recipe.n_steps + 1, min(rounds, recipe.buffer_size // copies))
        self.replay = Replay(rows, copies, inputs, recipe.n_steps, recipe.gamma, recipe.reward_scale, axes=axes)
        first, last = recipe.exploration_noise, recipe.exploration_noise_final
        self._noise = np.linspace(first, first if last is None else last, rounds)
        self._shares = np.linspace(0.25, 1.75, copies)[:, None]
        self._copies, self._done, self._count = copies, 0, 0
        self._random_steps, self._updates = recipe.random_steps, updates
        self._batch = Batch.of(recipe.batch_size, inputs, axes)
        self._output_buffers = OutputBuffers.of(self.networks.actor, 1)
        self._buffers = TD3Buffers.of(self.networks, recipe.batch_size)
        self._update = fixed_types(_update)

    def _initial(self, layers: Indices, last: float) -> Floats:
        """Uniform in 1/sqrt(inputs), the last layer in `last` times that, biases 0."""
        flat = np.zeros(size_of(layers), np.float32)
        matrices = views(flat, layers)[::2]
        for matrix in matrices:
            final = matrix is matrices[-1]
            bound = (last if final else 1.0) / math.sqrt(matrix.shape[1 if final else 0])
            matrix[:] = self._generator.uniform(-bound, bound, matrix.shape)
        return flat

    def resume(self, policy: ActorPolicy) -> None:
        """Start from an earlier actor. A policy has no critics: the actor rests until fresh ones have learned.

        Raises `Unsuitable` where it has another network.
        """
        layers = policy.layers
        own, other = views(self.actor.online, self.networks.actor)[:-2:2], [matrix for matrix, _ in layers[:-1]]
        refuse_other(*([len(hidden[0]), *(matrix.shape[1] for matrix in hidden)] for hidden in (own, other)))
        if policy.activation != "relu" or not policy.squashed:
            raise Unsuitable("the policy to start from is another kind of network than that of td3")
        (last, bias), hidden = layers[-1], layers[:-1]
        parts = [part for layer in hidden for part in layer] + [last.T, bias]
        self.actor = Weights.of(np.concatenate([part.ravel() for part in parts]))
        delay = self.schedule.delay
        rate, least = resumed_rate(self.recipe), self.recipe.learning_rate_final
        self.schedule = self.schedule._replace(
            rate=rate, decay=decay(rate, least, self._updates), still=int(_STILL * self._updates) // delay * delay
        )
        self._noise[:] = self._noise[-1]
        self._random_steps = 0

    def act(self, observation: Array) -> Array:
        shape = (self._copies, len(self.box.names))
        if self._done < self._random_steps:
            self._action = self._generator.uniform(-1, 1, shape)
        else:
            noise = self._noise[self._done] * self._shares * self._generator.standard_normal(shape)
            self._action = self.explored(observation, noise)
        self._done += 1
        return self._low + (self._action + 1) / 2 * self._span

    def explored(self, observation: Array, noise: Array) -> Array:
        """The actor's actions at observations (N, D) with noise (N, axes) added, within [-1, 1]: (N, axes)."""
        self._output_buffers = self._output_buffers.fit(self.networks.actor, len(observation))
        vectors = np.empty(noise.shape)
        _act(self.actor.online, self.networks.actor, observation, noise, self._output_buffers, vectors)
        return vectors

    def learn(self, observation: Array, action: Array, transition: Transition) -> None:
        """Store the step; of the actions those that `act` has kept, in [-1, 1]."""
        self.replay.add(observation, self._action, transition)
        if self._done > self.recipe.random_steps and self.replay.ready:
            first = self.replay.draw(self._generator, self.recipe.gradient_steps, self.recipe.batch_size)
            shape = (*first.shape, len(self.box.names))
            self.update(first, self._generator.standard_normal(shape, dtype=np.float32))

    def update(self, first: Integers, normal: Floats) -> None:
        """One update for each row of `first` (updates, B), from the transitions of the replay that begin there.

        `normal` (updates, B, axes) is noise on target actions.
        """
        self._update(
            self.actor, self.critics, self.networks, self.replay.memory, first, self._copies, normal, self.schedule,
            self._count, self._batch, self._buffers,
        )  # fmt: skip
        self._count += len(first)

    def compile(self) -> None:
        rows, axes = (1, self.recipe.batch_size), len(self.box.names)
        self.explored(np.zeros((1, self.replay.memory.observation.shape[1])), np.zeros((1, axes)))
        self.update(np.zeros(rows, np.int64), np.zeros((*rows, axes), np.float32))

    def policy(self) -> ActorPolicy:
        """That of the averaged weights."""
        parts = views(self.actor.average, self.networks.actor)
        hidden = list(zip(parts[:-2:2], parts[1:-2:2], strict=True))
        return ActorPolicy([*hidden, (parts[-2].T, parts[-1])], self.box, "relu", squashed=True)


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
    normal: Floats, schedule: Schedule, count: int, batch: Batch, buffers: TD3Buffers,
) -> None:  # fmt: skip
    """For each row of `first`, after `count` updates, a step for the critics, and every `delay` one for the actor."""
    for row in range(len(first)):
        rate = schedule.rate * schedule.decay**count
        count += 1
        acts = count % schedule.delay == 0
        tau = schedule.tau if acts else 0.0
        gather(memory, first[row], copies, batch)
        noise = Noise(normal[row], schedule.spread, schedule.limit)
        targets(actor.target, critics.target, networks, batch, noise, buffers)
        critic_gradient(critics.online, networks, batch, buffers, critics.gradient)
        step(critics, rate, count, np.inf, tau, 0.0)
        if acts and count > schedule.still:
            actor_gradient(actor.online, critics.online, networks, batch, schedule.penalty, buffers, actor.gradient)
            step(actor, rate, (count - schedule.still) // schedule.delay, np.inf, tau, 1 - schedule.averaging)
