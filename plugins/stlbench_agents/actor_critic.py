"""TD3's actor and two critics, and their updates, compiled; on the same parts as `dqn`'s engine.

The actor's vector has one network, the critics' two of the same shape, one behind the other. Outputs of the actor pass
through tanh; actions lie in [-1, 1].
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionBox, Array, Integers
from stlbench_agents.actor_policy import ActorPolicy
from stlbench_agents.compiler import compiled
from stlbench_agents.layers import Space, back_hidden, back_outputs, hidden, layout, outputs, size_of, views
from stlbench_agents.optimizer import Weights, step
from stlbench_agents.products import inner_product
from stlbench_agents.replay import Batch, Memory, Replay, gather

if TYPE_CHECKING:
    from stlbench_agents.td3 import TD3

__all__ = ["ActorCritic", "Networks", "Noise", "Work", "actor_gradient", "compile_all", "critic_gradient", "targets"]

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
        return Work(*spaces, *(np.zeros(size, dtype) for size in sizes))


class Schedule(NamedTuple):
    """What the updates need of the recipe."""

    rate: float
    decay: float
    """Of the learning rate, from one update to the next."""
    tau: float
    delay: int
    averaging: float
    penalty: float
    spread: float
    limit: float


class ActorCritic:
    """Actor and critics in training: their weights, their targets, and the actor's average."""

    def __init__(self, recipe: TD3, inputs: int, box: ActionBox, generator: np.random.Generator, updates: int) -> None:
        """Args: `inputs` D; `generator` of the initial weights; `updates` in all, for the learning rate."""
        self.box, self.networks = box, Networks.of(inputs, recipe.net_arch, len(box.names))
        self.actor = Weights.of(_initial(generator, self.networks.actor, last=0.1))
        self.critics = Weights.of(
            np.concatenate([_initial(generator, self.networks.critics[0], last=1.0) for _ in range(2)])
        )
        self.schedule = Schedule(
            recipe.learning_rate,
            (recipe.learning_rate_final / recipe.learning_rate) ** (1 / max(1, updates - 1)),
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
        self._work = Work.of(self.networks, recipe.batch_size)

    def policy(self, averaged: bool = False) -> ActorPolicy:
        """The actor as it is now, or with the average of its weights."""
        parts = views(self.actor.average if averaged else self.actor.online, self.networks.actor)
        hidden = list(zip(parts[:-2:2], parts[1:-2:2], strict=True))
        return ActorPolicy([*hidden, (parts[-2].T, parts[-1])], self.box, "relu", squashed=True)

    def act(self, observation: Array, noise: Array) -> Array:
        """The actor's actions at observations (N, D) with noise (N, axes) added, within [-1, 1]: (N, axes)."""
        vectors: Array = _act(self.actor.online, self.networks.actor, observation, noise)
        return vectors

    def saw(self, reward: Array) -> None:
        """Take note of rewards (N,): a value, a mean of rewards weighted by powers of gamma, lies among them."""
        least, most = self._scale * float(reward.min()), self._scale * float(reward.max())
        self.bounds = min(self.bounds[0], least), max(self.bounds[1], most)

    def update(self, memory: Memory, first: Integers, copies: int, normal: Floats) -> None:
        """One update for each row of `first` (updates, B), from the transitions that begin there.

        Args:
            memory: actions in [-1, 1].
            first: places in it, as `Replay.draw` gives them.
            copies: how far a transition is from that before it.
            normal: standard normal in single precision, (updates, B, axes), for the target actions.
        """
        _update(
            self.actor, self.critics, self.networks, memory, first, copies, normal, self.schedule,
            self.bounds, self._count, self._batch, self._work,
        )  # fmt: skip
        self._count += len(first)


def compile_all(recipe: TD3) -> None:
    """Call all that is compiled, on nothing of interest."""
    made = ActorCritic(recipe, 1, ActionBox(("a",), (-1.0,), (1.0,)), np.random.default_rng(0), 1)
    made.act(np.zeros((1, 1)), np.zeros((1, 1)))
    replay = Replay(2, 1, 1, 1, 0.0, axes=1)
    rows = (1, recipe.batch_size)
    made.update(replay.memory, np.zeros(rows, np.int64), 1, np.zeros((*rows, 1), np.float32))


def _initial(generator: np.random.Generator, layers: Indices, last: float) -> Floats:
    """Uniform in 1/sqrt(inputs), the last layer in `last` times that, biases 0."""
    begin = int(layers[0, 0])
    flat = np.zeros(size_of(layers) - begin, np.float32)
    matrices = views(flat, layers - np.array([begin, 0, 0, begin]))[::2]
    for matrix in matrices:
        final = matrix is matrices[-1]
        bound = (last if final else 1.0) / math.sqrt(matrix.shape[1 if final else 0])
        matrix[:] = generator.uniform(-bound, bound, matrix.shape)
    return flat


@compiled()
def _act(flat: Floats, layers: Indices, observation: Floats, noise: Floats) -> Floats:
    rows, inputs, axes = len(observation), observation.shape[1], layers[-1, 1]
    space_of = max(layers[:, 2].max(), layers[:, 1].max())
    x = np.empty(rows * inputs, flat.dtype)
    for i in range(rows):
        for j in range(inputs):
            x[i * inputs + j] = observation[i, j]
    activations = np.empty((len(layers) - 1, rows * space_of), flat.dtype)
    output, turned = np.empty(rows * axes, flat.dtype), np.empty(space_of * axes, flat.dtype)
    outputs(flat, layers, hidden(flat, layers, x, rows, activations), rows, turned, output)
    vectors = np.empty((rows, axes))
    for i in range(rows):
        for j in range(axes):
            vectors[i, j] = min(1.0, max(-1.0, math.tanh(output[i * axes + j]) + noise[i, j]))
    return vectors


@compiled()
def _update(
    actor: Weights, critics: Weights, networks: Networks, memory: Memory, first: Integers, copies: int,
    normal: Floats, schedule: Schedule, bounds: tuple[float, float], count: int, batch: Batch, work: Work,
) -> None:  # fmt: skip
    """For each row of `first` a step of Adam for the critics, and every `delay` one for the actor; followers move.

    `count` updates have been before.
    """
    for row in range(len(first)):
        rate = schedule.rate * schedule.decay**count
        count += 1
        acts = count % schedule.delay == 0
        tau = schedule.tau if acts else 0.0
        gather(memory, first[row], copies, batch)
        noise = Noise(normal[row], schedule.spread, schedule.limit)
        targets(actor.target, critics.target, networks, batch, noise, bounds, work)
        critic_gradient(critics.online, networks, batch, work, critics.gradient)
        step(critics, rate, count, np.inf, tau, 0.0)
        if acts:
            actor_gradient(actor.online, critics.online, networks, batch, schedule.penalty, work, actor.gradient)
            step(actor, rate, count // schedule.delay, np.inf, tau, 1 - schedule.averaging)


@compiled()
def _join(observation: Floats, action: Floats, into: Floats) -> None:
    """Observations (B, D) and actions (B, axes) side by side."""
    rows, inputs, axes = len(observation), observation.shape[1], action.shape[1]
    for i in range(rows):
        begin = i * (inputs + axes)
        for j in range(inputs):
            into[begin + j] = observation[i, j]
        for j in range(axes):
            into[begin + inputs + j] = action[i, j]


@compiled()
def _output(
    flat: Floats, layers: Indices, observation: Floats, activations: Floats, turned: Floats, into: Floats
) -> None:
    """The actor's output before the tanh."""
    rows = len(observation)
    last = hidden(flat, layers, observation.reshape(observation.size), rows, activations)
    outputs(flat, layers, last, rows, turned, into)


@compiled()
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
        last = hidden(critics, layers, work.joined, rows, work.critic.there)
        outputs(critics, layers, last, rows, work.critic.turned, work.value)
        for i in range(rows):
            work.goal[i] = work.value[i] if which == 0 else min(work.goal[i], work.value[i])
    for i in range(rows):
        goal = batch.returns[i] + batch.discount[i] * work.goal[i]
        work.goal[i] = min(kind(bounds[1]), max(kind(bounds[0]), goal))


@compiled()
def critic_gradient(critics: Floats, networks: Networks, batch: Batch, work: Work, into: Floats) -> None:
    """The gradient of Huber's loss of both critics, the sum of their means over the batch, by `work.goal`."""
    rows, kind = len(batch.returns), critics.dtype.type
    _join(batch.observation, batch.action, work.joined)
    for which in range(2):
        layers = networks.critics[which]
        last = hidden(critics, layers, work.joined, rows, work.critic.here)
        outputs(critics, layers, last, rows, work.critic.turned, work.value)
        for i in range(rows):
            error = work.value[i] - work.goal[i]
            work.value[i] = min(kind(1), max(kind(-1), error)) / kind(rows)
        back_outputs(critics, layers, last, work.value, rows, work.critic, True, into)
        back_hidden(critics, layers, work.joined, rows, work.critic, True, into)


@compiled()
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
    last = hidden(critics, layers, work.joined, rows, work.critic.here)
    for i in range(rows):
        work.value[i] = kind(-1) / kind(rows)
    back_outputs(critics, layers, last, work.value, rows, work.critic, False, into)
    back = back_hidden(critics, layers, work.joined, rows, work.critic, False, into)
    width, share = layers[0, 2], kind(2 * penalty / (rows * axes))
    for i in range(rows):
        for j in range(axes):
            at = i * axes + j
            slope = inner_product(back, i * width, critics, layers[0, 0] + (inputs + j) * width, width)
            action = work.by_output[at]
            work.by_output[at] = slope * (kind(1) - action * action) + share * work.output[at]
    x = batch.observation.reshape(batch.observation.size)
    final = work.actor.here[len(networks.actor) - 2]
    back_outputs(actor, networks.actor, final, work.by_output, rows, work.actor, True, into)
    back_hidden(actor, networks.actor, x, rows, work.actor, True, into)
