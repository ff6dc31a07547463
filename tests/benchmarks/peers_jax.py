"""Training as one JAX program: environment, replay and updates in a single `lax.scan`; DQN and TD3, written for speed.

There is no harness around it: the pendulum, its inputs and the reward (of `raw`) are written for JAX, and nothing is
reported on the way. So this is what our loop, whose environments are ordinary Python, has to be compared with.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple, Protocol, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import Array, lax, random

from benchmarks.pendulum import Pendulum

__all__ = ["JaxDQN", "JaxTD3", "check_pendulum", "jax_training"]

Layers: TypeAlias = tuple[tuple[Array, Array], ...]
"""A matrix (inputs, outputs) and a bias (outputs,) for each layer."""
State: TypeAlias = Any
"""What an agent learns with: any tree of arrays."""

INPUTS, BATCH, ROWS, GAMMA = 5, 128, 65536, 0.95
TORQUE, END = 3.0, 2000


class World(NamedTuple):
    """N pendulums: angle and speed (N, 2), and the step of each (N,)."""

    state: Array
    t: Array


class Transitions(NamedTuple):
    """Of each: inputs before and after (n, 5), the action, the reward (n,)."""

    observation: Array
    arrived: Array
    action: Array
    reward: Array


class Replay(NamedTuple):
    """The last ROWS transitions, and how many there ever were."""

    rows: Transitions
    count: Array


class Learner(Protocol):
    """What the loop asks an agent for. `count` are the environment steps so far."""

    def initial(self, key: Array) -> State:
        """Before the first update."""

    def act(self, state: State, observation: Array, key: Array) -> Array:
        """Actions at (N, 5), with exploration."""

    def torque(self, action: Array) -> Array:
        """Of actions, in N m: (N,)."""

    def update(self, state: State, batch: Transitions, key: Array, number: Array) -> State:
        """After update `number`, counted from 1."""


def jax_training(learner: Learner, copies: int, steps: int) -> Callable[[], Any]:
    """A function that trains for `steps` environment steps more at each call, with one update a step.

    `copies` environments act together, and as many updates follow; `steps` and ROWS are multiples of it.
    """

    @partial(jax.jit, donate_argnums=0)
    def train(carry: Any) -> Any:
        return lax.scan(lambda now, _: (_lock_step(learner, now), None), carry, None, length=steps // copies)[0]

    first, last = random.split(random.key(0))
    world = World(jnp.zeros((copies, 2)), jnp.zeros(copies, jnp.int32))
    state = learner.initial(first)
    carry = [(state, world, _empty(learner.act(state, _inputs(world), first)), last)]

    def work() -> None:
        carry[0] = jax.block_until_ready(train(carry[0]))

    return work


def check_pendulum() -> None:
    """The pendulum here is that of the others, to single precision."""
    system, generator, torque = Pendulum(0.01), np.random.default_rng(0), np.linspace(-TORQUE, TORQUE, 64)
    state, t = generator.uniform(-3, 3, (64, 2)), generator.integers(END, size=64)
    moved = _moved(World(jnp.array(state), jnp.array(t)), jnp.array(torque))
    np.testing.assert_allclose(moved.state, system.step(state, torque[:, None]), atol=1e-5)
    np.testing.assert_allclose(_inputs(moved)[:, :4], system.features(np.array(moved.state), t + 1), atol=1e-5)


def _lock_step(learner: Learner, carry: Any) -> Any:
    """All copies take a step, and as many updates follow."""
    state, world, replay, key = carry
    key, acting, starting, learning = random.split(key, 4)
    observation = _inputs(world)
    action = learner.act(state, observation, acting)
    world = _moved(world, learner.torque(action))
    replay = _stored(replay, Transitions(observation, _inputs(world), action, _reward(world)))
    copies = len(world.t)

    def update(i: Array, before: State) -> State:
        drawing, updating = random.split(random.fold_in(learning, i))
        return learner.update(before, _drawn(replay, drawing), updating, replay.count - copies + i + 1)

    state = lax.fori_loop(0, copies, update, state) if copies > 1 else update(jnp.int32(0), state)
    return state, _restarted(world, starting), replay, key


# ------------------------------------------------------------------------------------------------ the pendulum, replay


def _moved(world: World, torque: Array) -> World:
    """`benchmarks.pendulum.Pendulum.step`."""
    theta, omega = world.state.T
    change = 19.6 * jnp.sin(theta) + (torque - 0.05 * omega) / 0.0375
    return World(jnp.stack([theta + 0.01 * omega, omega + 0.01 * change], axis=1), world.t + 1)


def _restarted(world: World, key: Array) -> World:
    over = world.t >= END
    start = random.uniform(key, world.state.shape, minval=-1.0) * jnp.array([3.14, 1.0])
    return World(jnp.where(over[:, None], start, world.state), jnp.where(over, 0, world.t))


def _inputs(world: World) -> Array:
    """`benchmarks.pendulum.Pendulum.features`, and the time: (N, 5)."""
    (theta, omega), t = world.state.T, world.t
    distance = (theta - _target(t) + jnp.pi) % (2 * jnp.pi) - jnp.pi
    return jnp.stack([jnp.cos(theta), jnp.sin(theta), omega / 5, distance / jnp.pi, t / 1000 - 1], axis=1)


def _reward(world: World) -> Array:
    """The margin of the predicates of the time, as of `raw`: (N,)."""
    theta, omega = world.state.T
    return jnp.minimum(0.05 - jnp.abs(_target(world.t) - theta), 0.05 - jnp.abs(omega))


def _target(t: Array) -> Array:
    return jnp.where(t <= 700, 0.0, jnp.where(t <= 1200, 1.57, -1.57))


def _empty(action: Array) -> Replay:
    """Args: `action` of all copies, an example."""
    inputs = jnp.zeros((ROWS, INPUTS))
    actions = jnp.zeros((ROWS, *action.shape[1:]), action.dtype)
    return Replay(Transitions(inputs, inputs + 0, actions, jnp.zeros(ROWS)), jnp.int32(0))


def _stored(replay: Replay, new: Transitions) -> Replay:
    at = replay.count % ROWS
    rows = jax.tree.map(lambda kept, came: lax.dynamic_update_slice_in_dim(kept, came, at, 0), replay.rows, new)
    return Replay(rows, replay.count + len(new.reward))


def _drawn(replay: Replay, key: Array) -> Transitions:
    rows = random.randint(key, (BATCH,), 0, jnp.minimum(replay.count, ROWS))
    return Transitions(*(each[rows] for each in replay.rows))


# ----------------------------------------------------------------------------------------------------------- networks


def _network(key: Array, *widths: int) -> Layers:
    keys = random.split(key, len(widths) - 1)
    return tuple(
        (random.normal(one, (rows, columns)) * jnp.sqrt(2 / rows), jnp.zeros(columns))
        for one, (rows, columns) in zip(keys, pairwise(widths), strict=True)
    )


def _values(layers: Layers, x: Array) -> Array:
    for matrix, bias in layers[:-1]:
        x = jax.nn.relu(x @ matrix + bias)
    matrix, bias = layers[-1]
    return x @ matrix + bias


def _descended(adam: optax.GradientTransformation, gradient: Any, moments: Any, weights: Any) -> tuple[Any, Any]:
    change, moments = adam.update(gradient, moments, weights)
    return optax.apply_updates(weights, change), moments


@dataclass(frozen=True)
class JaxDQN:
    """MLP 128 x 128, Adam with the gradient clipped to norm 10, target copied every 1000 updates, epsilon 0.05."""

    actions: int

    @property
    def adam(self) -> optax.GradientTransformation:
        """With clipping."""
        return optax.chain(optax.clip_by_global_norm(10.0), optax.adam(1e-3))

    def initial(self, key: Array) -> State:
        """Network, target, Adam's moments."""
        online = _network(key, INPUTS, 128, 128, self.actions)
        return online, jax.tree.map(jnp.copy, online), self.adam.init(online)

    def act(self, state: State, observation: Array, key: Array) -> Array:
        """Epsilon-greedy."""
        whether, which = random.split(key)
        count = len(observation)
        any_of_them = random.randint(which, (count,), 0, self.actions)
        best = _values(state[0], observation).argmax(1).astype(jnp.int32)
        return jnp.where(random.uniform(whether, (count,)) < 0.05, any_of_them, best)

    def torque(self, action: Array) -> Array:
        """61 of them; what a larger grid has beside does nothing."""
        return 2 * TORQUE * (action % 61) / 60 - TORQUE

    def update(self, state: State, batch: Transitions, key: Array, number: Array) -> State:
        """A step of Adam on the squared error to the one-step return."""
        online, target, moments = state
        goal = batch.reward + GAMMA * _values(target, batch.arrived).max(1)

        def loss(layers: Layers) -> Array:
            taken = jnp.take_along_axis(_values(layers, batch.observation), batch.action[:, None], axis=1)[:, 0]
            return jnp.mean((taken - goal) ** 2)

        online, moments = _descended(self.adam, jax.grad(loss)(online), moments, online)
        target = jax.tree.map(lambda new, old: jnp.where(number % 1000 == 0, new, old), online, target)
        return online, target, moments


@dataclass(frozen=True)
class JaxTD3:
    """MLPs 64 x 64, Adam, policy delay 2, tau 0.01, noise 0.2 on actions and 0.1, at most 0.25, on target actions."""

    @property
    def adam(self) -> optax.GradientTransformation:
        """Of the actor and of the critics."""
        return optax.adam(1e-3)

    def initial(self, key: Array) -> State:
        """Actor and both critics, their targets, Adam's moments of the actor and of the critics."""
        one, two, three = random.split(key, 3)
        critics = tuple(_network(each, INPUTS + 1, 64, 64, 1) for each in (one, two))
        online = _network(three, INPUTS, 64, 64, 1), critics
        moments = tuple(self.adam.init(each) for each in online)
        return online, jax.tree.map(jnp.copy, online), moments

    def act(self, state: State, observation: Array, key: Array) -> Array:
        """The actor's action in [-1, 1] with noise, (N, 1)."""
        return _noisy(_action(state[0][0], observation), 0.2 * random.normal(key, (len(observation), 1)))

    def torque(self, action: Array) -> Array:
        """Any torque between the ends."""
        return TORQUE * action[:, 0]

    def update(self, state: State, batch: Transitions, key: Array, number: Array) -> State:
        """A step of Adam for the critics, and every second time one for the actor and the targets."""
        (actor, critics), target, (of_actor, of_critics) = state
        goal = batch.reward + GAMMA * self._later(target, batch.arrived, key)

        def loss(both: tuple[Layers, Layers]) -> Array:
            errors = (_value(each, batch.observation, batch.action) - goal for each in both)
            return sum((jnp.mean(error**2) for error in errors), start=jnp.float32(0))

        critics, of_critics = _descended(self.adam, jax.grad(loss)(critics), of_critics, critics)
        act = partial(self._act_better, critics, batch.observation)
        actor, of_actor, target = lax.cond(number % 2 == 0, act, lambda *same: same, actor, of_actor, target)
        return (actor, critics), target, (of_actor, of_critics)

    def _later(self, target: Any, arrived: Array, key: Array) -> Array:
        """The lesser of the critics' values at the noisy target action, (B,)."""
        actor, critics = target
        noise = jnp.clip(0.1 * random.normal(key, (len(arrived), 1)), -0.25, 0.25)
        action = _noisy(_action(actor, arrived), noise)
        return jnp.minimum(*(_value(each, arrived, action) for each in critics))

    def _act_better(self, critics: Any, observation: Array, actor: Layers, moments: Any, target: Any) -> Any:
        def loss(layers: Layers) -> Array:
            return -jnp.mean(_value(critics[0], observation, _action(layers, observation)))

        actor, moments = _descended(self.adam, jax.grad(loss)(actor), moments, actor)
        return actor, moments, jax.tree.map(lambda old, new: 0.99 * old + 0.01 * new, target, (actor, critics))


def _action(actor: Layers, observation: Array) -> Array:
    return jnp.tanh(_values(actor, observation))


def _noisy(action: Array, noise: Array) -> Array:
    return jnp.clip(action + noise, -1.0, 1.0)


def _value(critic: Layers, observation: Array, action: Array) -> Array:
    return _values(critic, jnp.concatenate([observation, action], axis=1))[:, 0]
