"""A task as pure functions of JAX arrays, which `jax.jit`, `jax.vmap` and `jax.lax.scan` take: a prototype.

No mathematics is written a second time. Systems, predicates and methods call functions of NumPy. NumPy lets an array
of another library compute by itself (its proposals NEP 13 and NEP 18). `Traced` is such an array: it hands each call
over to the function of `jax.numpy` with the same name. So JAX records what the harness's own code does. The writer of
the harness makes the predicates from the formula.

`python studies/device_world.py` measures how many steps it makes a CPU second, beside the ordinary environment.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import fields, replace
from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import numpy as np
from jax import Array, lax
from jax import numpy as jnp

from stlbench.contract import RewardMethod, Specification
from stlbench.simulation.environment import BatchEnvironment, Simulator
from stlbench.stl import Formula
from stlbench.stl.predicates.writer import ARRAYS, FormulaWriter, functions, indented
from stlbench.task import Task, build_method, load_task


class Traced(np.lib.mixins.NDArrayOperatorsMixin):
    """An array of JAX for the functions of NumPy. A part of it by integers and slices is a view, as in NumPy."""

    def __init__(self, own: Any, of: tuple[Traced, Any] | None = None) -> None:
        """Args: `of` is the array of which this is a part, and its place there; then `own` counts for nothing."""
        self._own, self._of = own, of

    @property
    def value(self) -> Any:
        return self._own if self._of is None else self._of[0].value[self._of[1]]

    def become(self, value: Any) -> Traced:
        """Take other numbers, in place."""
        if self._of is None:
            self._own = value
        else:
            whole, place = self._of
            whole.become(whole.value.at[place].set(value))
        return self

    def __getitem__(self, place: Any) -> Traced:
        places = place if isinstance(place, tuple) else (place,)
        if all(isinstance(each, int | slice | type(None) | type(...)) for each in places):
            return Traced(None, (self, place))
        return Traced(self.value[_plain(place)])

    def __setitem__(self, place: Any, value: Any) -> None:
        self.become(self.value.at[_plain(place)].set(_plain(value)))

    def __len__(self) -> int:
        return len(self.value)

    def __iter__(self) -> Any:
        return (self[i] for i in range(len(self)))

    def __bool__(self) -> bool:
        return bool(self.value)  # JAX says that nobody knows it yet

    def __getattr__(self, name: str) -> Any:
        """`shape`, `T`, `copy` and the like. Other than a part, what they give is a copy."""
        if name.startswith("__"):
            raise AttributeError(name)
        found = getattr(self.value, name)
        return partial(_called, found) if callable(found) else _traced(found)

    def __array_namespace__(self) -> Any:
        return SimpleNamespace(asarray=lambda table: Traced(jnp.asarray(table)))

    def __array__(self, *args: Any, **options: Any) -> Any:
        raise TypeError("a traced array has no numbers yet: use functions of NumPy that other arrays can take over")

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *inputs: Any, out: Any = None, **options: Any) -> Any:
        if method != "__call__" or not hasattr(jnp, ufunc.__name__):
            return NotImplemented
        result = _called(getattr(jnp, ufunc.__name__), *inputs, **options)
        return result if out is None else out[0].become(result.value)

    def __array_function__(self, function: Any, types: Any, args: Any, options: Any) -> Any:
        theirs = getattr(jnp, function.__name__, None)
        return NotImplemented if theirs is None else _called(theirs, *args, **options)


def _called(function: Callable[..., Any], *args: Any, **options: Any) -> Any:
    return _traced(function(*map(_plain, args), **{name: _plain(value) for name, value in options.items()}))


def _traced(value: Any) -> Any:
    return Traced(value) if isinstance(value, Array) else value


def _plain(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return type(value)(map(_plain, value))
    return value.value if isinstance(value, Traced) else value


class TracedSpecification(Specification):
    """A specification whose margins are of traced samples."""

    def margin(self, psi: Formula) -> Callable[[Any], Any]:
        """The same source as for arrays, but for the line that makes arrays of other samples."""
        columns = {name: i for i, name in enumerate(self.signals)}
        body = FormulaWriter(columns, replace(ARRAYS, first=""), "margin").statements(psi, False)
        if not isinstance(body, list):
            return lambda samples: Traced(jnp.full(samples.shape[:-1], body))
        return functions(["def predicate(sample):", *indented(body)], ARRAYS.namespace)["predicate"]


class DeviceWorld(NamedTuple):
    """One copy of a task with a method, as pure functions. `jax.vmap` makes many of it."""

    step: Callable[[Array, Array], Array]
    """One sampling time later: state (n,), action (axes,) -> (n,). An action is clipped to its range."""
    signals: Callable[[Array], Array]
    """State (n,) -> (k,)."""
    begin: Callable[[Array], Array]
    """The memory at the first sample of an episode: signals (k,) -> (m,)."""
    reward: Callable[[Array, Array, Array, Array], tuple[Array, Array]]
    """Memory (m,), signals before and after a step (2, k), action (axes,), t () before it -> reward (), memory (m,)."""
    horizon: int
    hold: int


def device_world(task: Task, method: Callable[[Specification], RewardMethod]) -> DeviceWorld:
    """Raises `Unsuitable` where the task is no system or the method does not fit.

    A function that leaves NumPy, or asks what a number is, fails when it is first traced, not here.
    """
    system, given = task.system, task.specification
    specification = TracedSpecification(**{each.name: getattr(given, each.name) for each in fields(given)})
    built = method(specification)
    low, high = jnp.array(task.actions.low), jnp.array(task.actions.high)

    def row(value: Array) -> Traced:
        return Traced(value[None])

    def step(state: Array, action: Array) -> Array:
        return _plain(system.step(row(state), row(jnp.clip(action, low, high))))[0]

    def signals(state: Array) -> Array:
        return _plain(system.signals(row(state)))[0]

    def begin(first: Array) -> Array:
        return jnp.asarray(_plain(built.initial_memory(row(first), row(jnp.array(0)))))[0]

    def reward(memory: Array, samples: Array, action: Array, t: Array) -> tuple[Array, Array]:
        paid, after = built.along(Traced(samples[:, None]), row(action), row(t), row(memory))
        return _plain(paid)[0, 0], _plain(after)[0]

    return DeviceWorld(step, signals, begin, reward, task.file.steps, task.file.hold)


class Run(NamedTuple):
    rewards: Array  # (decisions,), the mean over the steps of each
    samples: Array  # (decisions, hold, k), those after each step


def run(world: DeviceWorld, starts: Array, actions: Array) -> Run:
    """Episodes from states (episodes, n) in turn, with actions (decisions, axes), in one scan."""

    def step(carry: Any, action: Array) -> Any:
        state, memory, t = carry
        after = world.step(state, action)
        samples = jnp.stack([world.signals(state), world.signals(after)])
        paid, memory = world.reward(memory, samples, action, t)
        return (after, memory, t + 1), (paid, samples[1])

    def decide(carry: Any, action: Array) -> Any:
        number, *now = carry
        now, (paid, samples) = lax.scan(lambda each, _: step(each, action), tuple(now), None, length=world.hold)
        over = now[2] == world.horizon
        number = number + over
        fresh = begun(starts[number % len(starts)])
        now = jax.tree.map(lambda new, old: jnp.where(over, new, old), fresh, now)
        return (number, *now), Run(paid.mean(), samples)

    def begun(state: Array) -> tuple[Array, Array, Array]:
        return state, world.begin(world.signals(state)), jnp.array(0)

    return lax.scan(decide, (jnp.array(0), *begun(starts[0])), actions)[1]


TASKS = ("pendulum", "robot-nav", "overlap")
COPIES = (1, 64, 1024)
CALLS, SECONDS = 3, 0.5
"""A rate is the median of this many, each over at least so many CPU seconds, after a first call that compiles."""


def rates(name: str, method: str, copies: int) -> dict[str, float]:
    """Steps a CPU second: of a `Simulator`, of the environment of a training, and of the world here, bits a number."""
    task = load_task(name)
    low, high, decisions = task.actions.low, task.actions.high, task.file.steps // task.file.hold
    actions = np.random.default_rng(0).uniform(low, high, (copies, decisions, len(low)))
    starts = task.starts.of_training(np.random.default_rng(0), copies)
    built = build_method(task, method)
    simulator, environment = Simulator(task, built), BatchEnvironment(task, built, copies, 0)

    def simulated() -> None:
        simulator.reset(starts)
        for decision in range(decisions):
            simulator.advance(actions[:, decision])

    def trained() -> None:
        for decision in range(decisions):
            environment.step(actions[:, decision])

    steps = copies * task.file.steps
    found = {"simulator": _rate(simulated, steps), "environment": _rate(trained, steps)}
    for bits in (64, 32):
        with jax.enable_x64(bits == 64):
            world = device_world(task, lambda given: build_method(given, method))
            compiled = jax.jit(jax.vmap(lambda start, taken, world=world: run(world, start, taken).rewards))
            given = jnp.asarray(starts[:, None]), jnp.asarray(actions)
            call, begun = partial(compiled, *given), time.process_time()
            jax.block_until_ready(call())
            found[f"first call, s, {bits}"] = time.process_time() - begun
            found[f"JAX {bits}"] = _rate(call, steps)
    return found


def _rate(work: Callable[[], Any], steps: int) -> float:
    """Steps a second of calls that make so many steps each. JAX returns before it has computed, so it is waited for."""
    work()
    found = list[float]()
    for _ in range(CALLS):
        begun, calls = time.process_time(), 0
        while time.process_time() - begun < SECONDS:
            jax.block_until_ready(work())
            calls += 1
        found.append(calls * steps / (time.process_time() - begun))
    return float(np.median(found))


if __name__ == "__main__":
    for name in TASKS:
        for copies in COPIES:
            row = rates(name, "funnel", copies)
            print(f"{name:10} {copies:5}", *(f"{key} {value:,.3g}" for key, value in row.items()), sep="  ", flush=True)
