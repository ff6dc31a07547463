"""The rules of an environment or a world, whose starts are seeds and whose state nobody can set."""

from __future__ import annotations

import numpy as np

from stlbench import stl
from stlbench.contract import ActionGrid, Array, GymTask, Integers, World
from stlbench.rollout import referee
from stlbench.rollout.early_ends import without_end
from stlbench.rollout.worlds import make_world
from stlbench.task import Task
from stlbench.task.gym_spaces import outside_space
from stlbench.testing.rules import Rules

_COPIES = 4
_STEPS = 200  # the most steps of an episode that are run again to compare


def random_traces(task: Task, rules: Rules) -> Array:
    """Traces (N, T + 1, k) under random actions, along which the rules of worlds are checked."""
    actions = _actions(task, np.random.default_rng(0))
    begun, world = task.starts.report_and_selection()[0], make_world(task, _COPIES)
    begun = np.resize(begun, (_COPIES, begun.shape[1]))
    trace = _episode(task, rules, world, begun, actions)
    if world.can_end:
        _warn_of_ends(task, rules, trace, np.where(world.ended, world.lived, task.file.steps))
    few = max(1, _STEPS // task.file.hold)
    again = _episode(task, rules, world, begun, actions[:few])
    same = np.array_equal(again, trace[:, : again.shape[1]])
    rules.keep(same, "the same seeds and actions give the same episodes", "another episode in the same copies")
    alone = _episode(task, rules, make_world(task, 1), begun[-1:], actions[:few, -1:])
    same = np.array_equal(alone[0], again[-1])
    rules.keep(same, "an episode is the same in another copy", "another episode in a copy of its own")
    _check_restart(task, rules, world, begun)
    return trace


def _warn_of_ends(task: Task, rules: Rules, traces: Array, lasted: Integers) -> None:
    """Warn if random actions end an episode before the formula is decided: a policy may learn to do that."""
    recorded = traces if task.file.terminated == "hold" else without_end(traces.copy(), lasted)
    satisfied, horizon = np.array(referee.score(task, recorded).satisfied), stl.horizon(task.formula)
    early = lasted < horizon
    if early.any():
        said = (
            f"{early.sum()} of {len(early)} episodes of random actions end before step {horizon}, the formula's horizon"
        )
        rule = f"by `terminated: {task.file.terminated}` {(early & satisfied).sum()} of these satisfy the formula"
        rules.warnings.append(f"{said}; {rule}")


def _actions(task: Task, generator: np.random.Generator) -> Array:
    """Random ones of a whole episode: (decisions, N, axes)."""
    actions, shape = task.actions, (task.file.steps // task.file.hold, _COPIES)
    if isinstance(actions, ActionGrid):
        return actions.vectors[generator.integers(actions.size, size=shape)]
    return generator.uniform(actions.low, actions.high, (*shape, len(actions.names)))


def _episode(task: Task, rules: Rules, world: World, begun: Array, actions: Array) -> Array:
    """The trace of one episode in each copy."""
    k, hold, count = len(task.signals), task.file.hold, len(begun)
    low, high = np.array(task.specification.low), np.array(task.specification.high)
    world.restart(np.arange(count), begun)
    rules.keep(world.signals.shape == (count, k), f"signals has shape (N, {k})", world.signals.shape)
    outside = np.argwhere(~((low <= world.signals) & (world.signals <= high)))
    got = [f"{task.signals[column]} is {world.signals[row, column]}" for row, column in outside[:1]]
    rules.keep(not got, "the first samples lie in the signals' ranges", "".join(got))
    begin = np.zeros(count, dtype=np.int64)
    _warn_of_outside(task, rules, world.features(begin), begin)
    trace = [world.signals[None].copy()]
    for i, action in enumerate(actions):
        ended, before = world.ended.copy(), world.signals.copy()
        samples = world.advance(action, hold)
        _check_samples(rules, samples, before, (hold + 1, count, k))
        rules.keep(*_finite(task, samples, i * hold))
        if world.can_end:
            rules.keep(bool((samples[:, ended] == before[ended]).all()), "a copy that has ended stands still", samples)
        _check_features(task, rules, world, np.full(count, (i + 1) * hold), (low, high))
        trace.append(samples[1:])
    return np.concatenate(trace).transpose(1, 0, 2)


def _check_samples(rules: Rules, samples: Array, before: Array, shape: tuple[int, ...]) -> None:
    rules.keep(samples.shape == shape, "advance has shape (steps + 1, N, k)", samples.shape)
    rules.keep(np.array_equal(samples[0], before), "advance begins with the sample before it", samples[0])


def _finite(task: Task, samples: Array, t: int) -> tuple[bool, str, object]:
    """The rule, and the first sample that breaks it, of samples (hold + 1, N, k), the first at step t."""
    wrong = np.argwhere(~np.isfinite(samples))
    got = [f"{task.signals[k]} is {samples[i, row, k]} at step {t + i} of copy {row}" for i, row, k in wrong[:1]]
    return not got, "samples are finite", "".join(got)


def _check_features(task: Task, rules: Rules, world: World, t: Integers, box: tuple[Array, Array]) -> None:
    features = world.features(t)
    rules.keep(features.ndim == 2 and len(features) == len(t), "features has shape (N, d)", features.shape)
    _warn_of_outside(task, rules, features, t)
    rules.keep(bool(np.isfinite(features).all()), "features is finite", features)
    inside = np.all((box[0] <= world.signals) & (world.signals <= box[1]), axis=1)
    most = np.abs(features[inside]).max(axis=0, initial=0.0)
    place = int(np.argmax(most))
    said = f"{most[place]:.3g} of {_feature(task, place)}; a scale would help"
    rules.keep(bool(most[place] <= 5), "features are about in [-1, 1]", said)


def _warn_of_outside(task: Task, rules: Rules, features: Array, t: Integers) -> None:
    """Warn, once for each entry, of observations outside their space."""
    for row, _, said in task.source.observed.beyond(features) if isinstance(task.dynamics, GymTask) else ():
        if not any(said.partition(" is ")[0] in line for line in rules.warnings):
            problem = outside_space(said, f"at step {t[row]} of copy {row}")
            remedy = "`environment.scale` takes the place of these ends, and ranges should reach what signals take"
            rules.warnings.append(f"{problem}; {remedy}")


def _feature(task: Task, place: int) -> str:
    return task.source.observed.name(place) if isinstance(task.dynamics, GymTask) else f"number {place}"


def _check_restart(task: Task, rules: Rules, world: World, begun: Array) -> None:
    """One row begins anew, and the other rows stay."""
    world.restart(np.arange(_COPIES), begun)
    first = world.signals.copy()
    world.advance(np.tile(task.actions.low, (_COPIES, 1)).astype(np.float64), task.file.hold)
    others = world.signals[1:].copy()
    world.restart(np.array([0]), begun[:1])
    rules.keep(np.array_equal(world.signals[0], first[0]), "a row begins where its start says", world.signals[0])
    rules.keep(np.array_equal(world.signals[1:], others), "the other rows go on", world.signals[1:])
