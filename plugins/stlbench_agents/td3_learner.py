"""TD3 in training, compiled: the gradients of two critics and an actor, the weights, their updates, and actions; on
the parts of `dqn`.

The actor's vector has one network, the critics' two of the same shape, one behind the other. Outputs of the actor pass
through tanh; actions lie in [-1, 1].
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from stlbench.contract import ActionBox, Array, Arrays, Integers, Transition, Unsuitable
from stlbench_agents.kernels import compiled, fixed_types, flattened, inner_products, part
from stlbench_agents.layers import (
    OutputBuffers,
    PassBuffers,
    Weights,
    back_hidden,
    back_outputs,
    hidden,
    hidden_normalised,
    layout,
    outputs,
    outputs_at,
    size_of,
    step,
    views,
    zeros,
)
from stlbench_agents.plain_kernels import Floats, Indices
from stlbench_agents.policies import ActorPolicy
from stlbench_agents.replay import Batch, Memory, Replay, bounded_target, gather
from stlbench_agents.training import decay, rates_after, refuse_other

if TYPE_CHECKING:
    from stlbench_agents.td3 import TD3


class Networks(NamedTuple):
    """The shapes of actor and critics, as `stlbench_agents.layers` has them."""

    actor: Indices  # (L, 4)
    critics: Indices  # (2, L, 4): the place of each critic in the critics' vector

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
    def of(networks: Networks, rows: int, dtype: Any = np.float32, layer_norm: bool = False) -> TD3Buffers:
        axes, inputs = int(networks.actor[-1, 1]), int(networks.critics[0, 0, 1])
        sizes = (rows * inputs, rows * axes, rows, rows, rows * axes)
        critic = PassBuffers.of(networks.critics[0], rows, dtype, normalised=layer_norm)
        spaces = PassBuffers.of(networks.actor, rows, dtype), critic
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
def _hidden_of_critic(critics: Floats, layers: Indices, rows: int, buffers: TD3Buffers, into: Floats) -> None:
    """The hidden layers of a critic for the joined inputs."""
    if len(buffers.critic.scales):
        hidden_normalised(critics, layers, buffers.joined, rows, into, buffers.critic)
    else:
        hidden(critics, layers, buffers.joined, rows, into)


@part
def _single_output(flat: Floats, layers: Indices, last: Floats, rows: int, into: Floats) -> None:
    """As `outputs` for a network with one, as critics are: (B,)."""
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
        _hidden_of_critic(critics, layers, rows, buffers, buffers.critic.forward_only)
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
        _hidden_of_critic(critics, layers, rows, buffers, buffers.critic.forward)
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
    _hidden_of_critic(critics, layers, rows, buffers, buffers.critic.forward)
    for i in range(rows):
        buffers.value[i] = kind(-1) / kind(rows)
    back_outputs(critics, layers, buffers.critic.forward[-1], buffers.value, rows, buffers.critic, False, into)
    back = back_hidden(critics, layers, buffers.joined, rows, buffers.critic, False, into)
    width, share = layers[0, 2], kind(2 * penalty / (rows * axes))
    # Only the action's columns are needed of the gradient by the critic's inputs.
    for j in range(axes):
        inner_products(back, 0, rows, width, critics, layers[0, 0] + (inputs + j) * width, width, buffers.value)
        for i in range(rows):
            at = i * axes + j
            action = buffers.by_output[at]
            buffers.by_output[at] = buffers.value[i] * (kind(1) - action * action) + share * buffers.output[at]
    x = flattened(batch.observation)
    back_outputs(actor, networks.actor, buffers.actor.forward[-1], buffers.by_output, rows, buffers.actor, True, into)
    back_hidden(actor, networks.actor, x, rows, buffers.actor, True, into)


_STILL = 0.1
"""The share of a training from an earlier policy in which its actor rests."""


class Schedule(NamedTuple):
    rate: float
    decay: float  # factor on the learning rate, from one update to the next
    tau: float
    delay: int
    averaging: float
    penalty: float
    spread: float
    limit: float
    still: int  # updates before the first of the actor, a multiple of `delay`
    begun: int  # updates of the training that this one goes on with


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
            0,
        )
        self._copies, self._rounds, self._inputs = copies, rounds, inputs
        self.replay = self._empty_replay(rounds)
        first, last = recipe.exploration_noise, recipe.exploration_noise_final
        self._noise = np.linspace(first, first if last is None else last, rounds)
        self._shares = np.linspace(0.25, 1.75, copies)[:, None]  # several copies have the recipe's noise on average
        # Noise that lasts explores further, and fresh noise stays near the policy: half of the copies have each.
        self._lasting = np.where(np.arange(copies) % 2, recipe.lasting_noise, 0.0)[:, None]
        self._fresh = np.sqrt(1 - self._lasting**2)  # so the variance stays
        self._normal = np.zeros((copies, axes))
        self._done = self._count = 0
        self._random_steps, self._waiting, self._updates = recipe.random_steps, recipe.random_steps, updates
        self._batch = Batch.of(recipe.batch_size, inputs, axes)
        self._output_buffers = OutputBuffers.of(self.networks.actor, 1)
        self._buffers = TD3Buffers.of(self.networks, recipe.batch_size, layer_norm=recipe.layer_norm)
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

        Raises `Unsuitable` if it has another network.
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
        first, factor = rates_after(self.recipe, self._updates)
        still = int(_STILL * self._updates) // delay * delay
        self.schedule = self.schedule._replace(rate=first, decay=factor, still=still)
        self._noise[:] = self._noise[-1]
        self._random_steps = 0  # the earlier policy acts from the start, and updates begin as late as without it

    def _empty_replay(self, rounds: int) -> Replay:
        recipe, axes = self.recipe, len(self.box.names)
        rows = max(recipe.n_steps + 1, min(rounds, recipe.buffer_size // self._copies))
        returns = recipe.n_steps, recipe.gamma, recipe.reward_scale
        return Replay(rows, self._copies, self._inputs, *returns, axes=axes)

    def kept(self) -> Arrays:
        """The weights with Adam's moments, the newest transitions, and the place in the schedule."""
        rate = self.schedule.rate * self.schedule.decay ** (self._count - self.schedule.begun)
        numbers = self._count, rate, self._noise[self._done - 1]
        weights = {"actor": self.actor.kept(), "critics": self.critics.kept()}
        norm = np.array(self.recipe.layer_norm)
        return {**weights, **self.replay.kept(), "numbers": np.array(numbers), "layer_norm": norm}

    def go_on(self, earlier: Arrays) -> bool:
        """Go on with these `kept` arrays; False if they are of other networks or of another recipe for returns."""
        alike = self.actor.fit(earlier["actor"]) and self.critics.fit(earlier["critics"])
        recipe = self.recipe
        if not (alike and self.replay.fits(earlier) and bool(earlier.get("layer_norm")) == recipe.layer_norm):
            return False
        self.actor, self.critics = Weights.again(earlier["actor"]), Weights.again(earlier["critics"])
        self.replay = self._empty_replay(self._rounds + len(earlier["reward"]) // self._copies)
        self.replay.refill(earlier)
        count, rate, noise = earlier["numbers"].tolist()
        self._count = int(count) // recipe.policy_delay * recipe.policy_delay
        first, factor = rates_after(recipe, self._rounds * recipe.gradient_steps, rate)
        self.schedule = self.schedule._replace(rate=first, decay=factor, begun=self._count)
        self._noise = np.linspace(noise, min(noise, self._noise[-1]), self._rounds)
        self._random_steps = self._waiting = 0
        return True

    def act(self, observation: Array) -> Array:
        shape = (self._copies, len(self.box.names))
        if self._done < self._random_steps:
            self._action = self._generator.uniform(-1, 1, shape)
        else:
            self._normal = self._lasting * self._normal + self._fresh * self._generator.standard_normal(shape)
            self._action = self.explored(observation, self._noise[self._done] * self._shares * self._normal)
        self._done += 1
        return self._low + (self._action + 1) / 2 * self._span

    def explored(self, observation: Array, noise: Array) -> Array:
        """The actor's actions at observations (N, D) with noise (N, axes) added, within [-1, 1]: (N, axes)."""
        self._output_buffers = self._output_buffers.fit(self.networks.actor, len(observation))
        vectors = np.empty(noise.shape)
        _act(self.actor.online, self.networks.actor, observation, noise, self._output_buffers, vectors)
        return vectors

    def learn(self, observation: Array, action: Array, transition: Transition) -> None:
        """Store the step, with the actions in [-1, 1] that `act` has kept."""
        self.replay.add(observation, self._action, transition)
        if self._done > self._waiting and self.replay.ready:
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
        rate = schedule.rate * schedule.decay ** (count - schedule.begun)
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
