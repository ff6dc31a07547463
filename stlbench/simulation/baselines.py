"""Policies that act without learning: the controller by hand, the action zero, the best constant action, random
actions.

The referee scores them as policies: from the same starts, with the same `hold`. Nothing is simulated where the
task file states them (`TaskFile.baselines`).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import cycle, islice, product
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stlbench.contract import ActionGrid, Actions, Array, Integers, Policy, RewardMethod, System
from stlbench.records.result import LEARNED, Score, Summary
from stlbench.simulation import referee
from stlbench.simulation.environment import Simulator
from stlbench.simulation.faults import PluginFault, out_of_range
from stlbench.simulation.referee import Episodes, Referee
from stlbench.task.file import Baseline
from stlbench.task.task import Task


def record_controller(task: Task, begun: Array) -> Episodes | None:
    """The episodes when the controller acts from the starts (N, s); None where the task has none.

    Actions of a system are clipped, and on a grid the nearest action is taken, as for an agent. Raises `PluginFault`
    where actions have another shape, are no finite numbers, or are out of range and the task is no system.
    """
    actions, unpaid = task.actions, Unpaid(task.specification)
    first = Simulator(task, unpaid)
    first.reset(begun[:1])
    if first.world.by_hand(first.t) is None:
        return None

    def act(simulator: Simulator) -> Integers | Array:
        vectors = _checked(task, simulator.world.by_hand(simulator.t), simulator.t)
        return actions.nearest(vectors) if isinstance(actions, ActionGrid) else vectors

    return referee.simulate(task, unpaid, act, begun)


def score_controller(task: Task) -> Score | None:
    """The controller's score by the task's formula, from the report's starts; None where the task has none."""
    episodes = record_controller(task, task.starts.report_and_selection()[0])
    return None if episodes is None else referee.score(task, episodes.traces, lasted=episodes.lasted)


def replay(task: Task, actions: Integers | Array, begun: Array | None = None) -> Episodes:
    """The episodes under these actions, one for each decision.

    Args:
        task: whose actions are held.
        actions: indices of the grid (starts, decisions), or vectors (starts, decisions, axes).
        begun: the starts (N, s); the report's where left out.
    """
    begun, hold = task.starts.report_and_selection()[0] if begun is None else begun, task.file.hold
    return referee.simulate(task, Unpaid(task.specification), lambda at: actions[:, int(at.t[0]) // hold], begun)


class Unpaid(RewardMethod):
    """No reward and no memory: a controller needs neither."""

    def arrival(self, signals: Array, t: Integers) -> Array:
        return np.zeros(np.shape(t))


def _checked(task: Task, answer: Any, t: Integers) -> Array:
    """A controller's actions (N, axes) at steps t (N,), checked."""
    by_hand, actions, expected = f"{task.name}, by hand", task.actions, (len(t), len(task.actions.names))
    if answer is None:
        raise PluginFault(f"{by_hand}: the controller has no action at step {t.max()}")
    array: NDArray[Any] = np.asarray(answer)
    if array.dtype.kind not in "biuf" or array.shape != expected:
        rule = f"expected are {expected} for {', '.join(actions.names)}"
        raise PluginFault(f"{by_hand}: its actions are {array.dtype} {array.shape}; {rule}")
    vectors: Array = array.astype(np.float64)
    if isinstance(task.dynamics, System):
        # clipping would make an infinite action an end, and nobody would hear of it
        vectors = np.where(np.isfinite(vectors), np.clip(vectors, actions.low, actions.high), vectors)
    if wrong := out_of_range(actions, vectors):
        raise PluginFault(f"{by_hand}: {wrong}")
    return vectors


_ALL = 512  # a grid of no more actions is tried whole: the paper's robots have at most 273
_TRIED, _TRIED_IN_WORLDS = 32, 16
"""Actions that are tried first if there are more. A world has fewer, as each of its copies is a simulation."""
_STARTS = 16  # the most starts from which actions are compared
_AROUND = (0.2, 0.05, 0.0125)
"""Standard deviations, over an axis' span, of the actions that are tried around the best, half as many each time."""

_DIFFERENT = (1, 2, 4)
"""Different actions in a held sequence, by turns; or each piece has its own. Actions that change at each piece cancel
out: those that stay go far."""


@dataclass(frozen=True)
class Constants:
    """The scores of constant actions from the report's starts."""

    zero: Score
    best: Score  # that of the action which was best from the starts for selection
    action: tuple[float, ...]  # that action

    @property
    def trivial(self) -> bool:
        """Whether one of the two satisfies the formula as often as a policy that learned it (`LEARNED`)."""
        return max(self.zero.satisfaction, self.best.satisfaction) >= LEARNED


def zero(task: Task) -> Array:
    """The action zero (axes,): of a grid the nearest to it; the middle of an axis that leaves 0 out."""
    low, high = np.array(task.actions.low), np.array(task.actions.high)
    action: Array = _possible(task, np.where((low <= 0) & (high >= 0), 0.0, (low + high) / 2)[None])[0]
    return action


def constants(task: Task, starts: int = _STARTS) -> Constants:
    """The scores of the action zero and the best constant action: as the task file states, else measured.

    The best wins a race, first by satisfaction, from at most `starts` of the starts for selection. All actions of a
    grid of at most 512 race. Else zero, the corners, the middle and random ones do, 32 in all, and then three times 16
    around the best so far. On a world, which is dearer, these are 16 and three times 8.
    """
    if (stated := task.file.baselines) is not None:
        return Constants(_stated(task, stated.zero), _stated(task, stated.constant), stated.constant.action)
    best = _best(task, Referee(task, Unpaid(task.specification)), starts)
    return Constants(score_constant(task, zero(task)), score_constant(task, best), tuple(best.tolist()))


def score_constant(task: Task, action: Array) -> Score:
    """The score of one action (axes,), taken all the time; on a grid of the nearest action that there is."""
    return _score(task, _Constant(task, action))


def at_random(task: Task) -> Score:
    """The score of a policy that draws each action evenly from all: as the task file states, else measured."""
    if task.file.baselines is not None:
        return _stated(task, task.file.baselines.random)
    return _score(task, AtRandom(task))


def _stated(task: Task, baseline: Baseline) -> Score:
    return Score((), (), {}, Summary(baseline.robustness, nan, baseline.satisfied, task.file.starts))


def _score(task: Task, policy: Policy) -> Score:
    begun = task.starts.report_and_selection()[0]
    episodes = referee.record(task, Unpaid(task.specification), policy, begun)
    return referee.score(task, episodes.traces, lasted=episodes.lasted)


class _Constant(Policy):
    def __init__(self, task: Task, action: Array) -> None:
        actions, one = task.actions, action[None]
        self._action: Integers | Array = actions.nearest(one) if isinstance(actions, ActionGrid) else one

    def act(self, observation: Array) -> Integers | Array:
        which = np.zeros(len(observation), dtype=np.int64)
        return self._action[which]


class AtRandom(Policy):
    def __init__(self, task: Task) -> None:
        self._actions, self._generator = task.actions, np.random.default_rng(0)

    def act(self, observation: Array) -> Integers | Array:
        return random_actions(self._actions, self._generator, len(observation))


def random_actions(actions: Actions, generator: np.random.Generator, count: int) -> Integers | Array:
    """So many actions, drawn evenly from all: indices (count,) of a grid, or vectors (count, axes)."""
    if isinstance(actions, ActionGrid):
        return generator.integers(actions.size, size=count)
    return generator.uniform(actions.low, actions.high, (count, len(actions.low)))


def in_pieces(steps: int, count: int) -> Integers:
    """For each of some steps, which of `count` pieces of about the same length it is in: (steps,)."""
    return np.arange(steps) * count // steps


def held_at_random(actions: Actions, generator: np.random.Generator, copies: int, pieces: int) -> Integers | Array:
    """Sequences of random actions, some of which stay the same for several pieces or for all.

    They are indices of the grid (copies, pieces), or vectors (copies, pieces, axes).
    """

    def sequences() -> Iterator[Integers | Array]:
        for different in cycle((*_DIFFERENT, pieces)):
            count = min(different, pieces)
            yield random_actions(actions, generator, count)[in_pieces(pieces, count)]

    found: list[Any] = list(islice(sequences(), copies))
    stacked: Integers | Array = np.stack(found)
    return stacked


def _best(task: Task, referee: Referee, starts: int) -> Array:
    actions, generator = task.actions, np.random.default_rng(0)

    def winner(tried: Array) -> Array:
        best: Array = tried[referee.choose([_Constant(task, action) for action in tried], starts).best]
        return best

    if isinstance(actions, ActionGrid) and actions.size <= _ALL:
        return winner(np.concatenate([zero(task)[None], actions.vectors]))  # a race takes the first of equal ones
    low, high = np.array(actions.low), np.array(actions.high)
    count = _TRIED if isinstance(task.dynamics, System) else _TRIED_IN_WORLDS
    corners = list(islice(product(*zip(low, high, strict=True)), count - 2))
    drawn = generator.uniform(low, high, (count - 2 - len(corners), len(low)))
    best = winner(_possible(task, np.concatenate([zero(task)[None], corners, [(low + high) / 2], drawn])))
    for spread in _AROUND:
        around = best + spread * (high - low) * generator.normal(size=(count // 2, len(low)))
        best = winner(_possible(task, np.concatenate([best[None], np.clip(around, low, high)])))
    return best


def _possible(task: Task, vectors: Array) -> Array:
    """The vectors (n, axes), on a grid the nearest that it has."""
    actions = task.actions
    return actions.vectors[actions.nearest(vectors)] if isinstance(actions, ActionGrid) else vectors
