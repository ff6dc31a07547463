"""A quick search for a witness: a sequence of held actions whose episode satisfies the formula from one start.

It is an evolutionary search on the environment itself. It needs no gradient, no model and no state that can be set.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from stlbench.contract import ActionGrid, Array, Integers
from stlbench.rollout.baselines import held_at_random, in_pieces, random_actions
from stlbench.rollout.controller import replay
from stlbench.rollout.early_ends import judge
from stlbench.task import Task

COPIES, _ELITE = 32, 6
"""Episodes of a generation, and how many of all so far the next one is made from."""
_PIECES = 20
"""A sequence has at most so many actions. Each is held for an equal part of the episode."""
_NEW, _SPREAD = 0.15, 0.1
"""The share of actions that are drawn anew, and the standard deviation of changes of others, over an axis' span."""


@dataclass(frozen=True)
class Nearest:
    """The best episode of a search."""

    robustness: float
    """Greater than 0 if it satisfies: then it is a witness. A violated formula has at most 0."""
    episodes: int
    """That were played."""
    actions: tuple[tuple[float, ...], ...]
    """Vectors, each held for an equal part of the episode."""

    @property
    def satisfies(self) -> bool:
        """Whether it is a witness."""
        return self.robustness > 0


def search(task: Task, seconds: float, seed: int = 0) -> Nearest:
    """Search from the report's first start for about so many seconds, at least one generation; until a witness."""
    began, generator = time.perf_counter(), np.random.default_rng(seed)
    decisions = task.file.steps // task.file.hold
    pieces = min(_PIECES, decisions)
    when = in_pieces(decisions, pieces)
    start = np.repeat(task.starts.report_and_selection()[0][:1], COPIES, axis=0)
    pool = held_at_random(task.actions, generator, COPIES, pieces)
    best, scores, episodes = pool[:0], np.empty((0, 2)), 0
    while True:
        played = replay(task, pool[:, when], start)
        verdicts = judge(task.formula, played.traces, task.specification, task.file.terminated)
        episodes += len(pool)
        best = np.concatenate([best, pool])
        scores = np.concatenate([scores, np.stack([verdicts.robustness[:, 0], played.lasted], axis=1)])
        order = np.lexsort((scores[:, 1], scores[:, 0]))[::-1][:_ELITE]  # of equal ones the episode that lasted
        best, scores = best[order], scores[order]
        if scores[0, 0] > 0 or time.perf_counter() - began > seconds:
            actions = task.actions
            vectors = actions.vectors[best[0]] if isinstance(actions, ActionGrid) else best[0]
            return Nearest(float(scores[0, 0]), episodes, tuple(map(tuple, vectors.tolist())))
        pool = _changed(task, generator, best)


def _changed(task: Task, generator: np.random.Generator, elite: Integers | Array) -> Integers | Array:
    """The next generation: each piece from one of two parents, then changed a little, or drawn anew."""
    kept, pieces = elite.shape[:2]
    parents = generator.integers(kept, size=(COPIES, 2))
    which = np.where(generator.random((COPIES, pieces)) < 0.5, parents[:, :1], parents[:, 1:])
    children = elite[which, np.arange(pieces)]
    if not isinstance(task.actions, ActionGrid):
        low, high = np.array(task.actions.low), np.array(task.actions.high)
        noise = _SPREAD * (high - low) * generator.standard_normal(children.shape)
        children = np.clip(children + noise, low, high)
    new = generator.random((COPIES, pieces)) < _NEW
    children[new] = random_actions(task.actions, generator, int(new.sum()))
    return children
