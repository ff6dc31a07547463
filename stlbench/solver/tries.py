"""The first tries of a task: random actions, a quick search for a witness, the speed of the simulation, and what the
user is told of the task.

It is an evolutionary search on the environment itself. It needs no gradient, no model and no state that can be set.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from stlbench.contract import ActionGrid, Array, GymTask, Integers
from stlbench.errors import UsageError
from stlbench.records.result import LEARNED, Score
from stlbench.simulation import baselines, referee
from stlbench.simulation.baselines import Unpaid, held_at_random, in_pieces, random_actions, replay
from stlbench.simulation.environment import BatchEnvironment
from stlbench.simulation.verdicts import judge
from stlbench.solver.problem import why_impossible
from stlbench.study.progress import duration
from stlbench.task.task import Task
from stlbench.tracks.haste import too_fast

COPIES, _ELITE = 32, 6
"""Episodes of a generation, and how many of all so far the next one is made from."""
_MOST_ACTIONS = 20
"""A sequence has at most so many actions. Each is held for an equal part of the episode."""
_NEW_SHARE, _SPREAD = 0.15, 0.1
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
    trace: Array = field(repr=False)
    """Its samples (T + 1, k)."""
    pool: Integers | Array = field(repr=False)
    """The best sequences (n, pieces, ...), from which another search may begin."""

    @property
    def satisfies(self) -> bool:
        """Whether it is a witness."""
        return self.robustness > 0


def search(task: Task, seconds: float, begun: Array, near: Nearest | None = None) -> Nearest:
    """Search from a start (s,) for about so many seconds, at least one generation; until a witness.

    It begins with the sequences of another search, if there is one.
    """
    clock, generator = time.perf_counter(), np.random.default_rng(0)
    decisions = task.file.decisions
    pieces = min(_MOST_ACTIONS, decisions)
    when = in_pieces(decisions, pieces)
    pool = held_at_random(task.actions, generator, COPIES, pieces) if near is None else near.pool
    best, scores, traces, episodes = pool[:0], np.empty((0, 2)), np.empty((0,)), 0
    while True:
        played = replay(task, pool[:, when], np.repeat(begun[None], len(pool), axis=0))
        verdicts = judge(task.formula, played.traces, task.specification, task.file.terminated)
        episodes += len(pool)
        best = np.concatenate([best, pool])
        traces = np.concatenate([traces, played.traces]) if len(traces) else played.traces
        scores = np.concatenate([scores, np.stack([verdicts.robustness[:, 0], played.lasted], axis=1)])
        # early ends have one robustness under `violated`: of these the episode that lasted longest is the best
        order = np.lexsort((scores[:, 1], scores[:, 0]))[::-1][:_ELITE]
        best, scores, traces = best[order], scores[order], traces[order]
        if scores[0, 0] > 0 or time.perf_counter() - clock > seconds:
            actions = task.actions
            vectors = actions.vectors[best[0]] if isinstance(actions, ActionGrid) else best[0]
            return Nearest(float(scores[0, 0]), episodes, tuple(map(tuple, vectors.tolist())), traces[0], best)
        pool = _changed(task, generator, best)


def _changed(task: Task, generator: np.random.Generator, elite: Integers | Array) -> Integers | Array:
    """The next generation: each piece from one of two parents, then changed a little, or drawn anew."""
    kept, pieces = elite.shape[:2]
    parents = generator.integers(kept, size=(COPIES, 2))
    which = np.where(generator.random((COPIES, pieces)) < 0.5, parents[:, :1], parents[:, 1:])
    children = elite[which, np.arange(pieces)]
    if not isinstance(task.actions, ActionGrid):  # the indices of a grid know no small change
        low, high = np.array(task.actions.low), np.array(task.actions.high)
        noise = _SPREAD * (high - low) * generator.standard_normal(children.shape)
        children = np.clip(children + noise, low, high)
    new = generator.random((COPIES, pieces)) < _NEW_SHARE
    children[new] = random_actions(task.actions, generator, int(new.sum()))
    return children


FEWEST = 16
"""Starts of a score, at least."""
_SPEED_SECONDS = 3.0
"""Seconds for which the speed of the simulation is measured, at most."""
_TRIED_EPISODES = 110
"""Episodes of the first tries of a slow environment: at random, of constant actions, and scores."""
_ANNOUNCED_SECONDS = 20.0
"""Seconds of the first tries from which on they are announced."""
_REPEATED_STARTS = 2
"""Starts from which an episode is played again."""
RACE_SHARE = 0.4
"""The share of the time for the race."""
_LEAST_EPISODES, _LEAST_STEPS = 20, 3000
"""A training of fewer episodes, or of fewer steps, teaches nothing."""


def least(task: Task) -> int:
    """Steps of a training, at least."""
    return max(_LEAST_EPISODES * task.file.steps, _LEAST_STEPS)


def least_minutes(task: Task, each: float) -> float:
    """Minutes that suffice for the least training, at so many seconds a step."""
    return least(task) * each / (60 * RACE_SHARE)


def check_speed(task: Task, episode: float, minutes: float, say: Callable[[str], None]) -> None:
    """Says if the tries will take long. Raises `UsageError` where episodes of so many seconds are too slow for the
    minutes."""
    each, tried = episode / task.file.steps, _TRIED_EPISODES * episode
    needed = tried / 60 + least_minutes(task, each)
    slow = f"a step of the environment takes {1000 * each:.3g} ms"
    if needed > minutes:
        raise UsageError(f"{minutes:g} minutes are too short: {slow}; about {needed:.2g} minutes are needed")
    if tried > _ANNOUNCED_SECONDS:
        say(f"{slow}, so the first look takes about {duration(tried)}")


def try_at_random(task: Task) -> None:
    """Raises `UsageError` where episodes of random actions end at once, or a signal never changes."""
    policy, starts = baselines.AtRandom(task), task.starts.report_and_selection()[0][:FEWEST]
    episodes = referee.record(task, Unpaid(task.specification), policy, starts)
    if isinstance(task.dynamics, GymTask) and episodes.lasted.max() <= max(1, task.file.hold) < task.file.steps:
        raise UsageError(f"the environment ends at once: {len(starts)} of {len(starts)} random episodes had one step")
    for place, name in enumerate(task.signals):
        samples = episodes.traces[..., place]
        if np.nanmax(samples) == np.nanmin(samples) and not _is_flag(task, name):
            value = f"{np.nanmax(samples):g} in {len(starts)} episodes of random actions"
            raise UsageError(f"signal {name} is constant, {value}; a formula is over signals that change")


def is_repeatable(task: Task) -> bool:
    """Whether the same starts and actions give the same episodes: an environment may ignore its seeds."""
    starts = task.starts.report_and_selection()[0][:_REPEATED_STARTS]
    shape = len(starts), task.file.decisions
    drawn = baselines.random_actions(task.actions, np.random.default_rng(0), shape[0] * shape[1])
    actions = drawn.reshape(*shape, *drawn.shape[1:])
    first, second = (replay(task, actions, starts).traces for _ in range(2))
    return np.array_equal(first, second, equal_nan=True)


def simulation_seconds(task: Task) -> tuple[float, float]:
    """The seconds to make a copy of the simulation, and those of an episode that lasts to the end, one of several side
    by side. Copies stay, so only the first call says what making them takes."""
    making = time.perf_counter()
    environment = BatchEnvironment(task, Unpaid(task.specification), FEWEST, seed=0)
    policy, nothing = baselines.AtRandom(task), np.empty((FEWEST, 0))
    began = time.perf_counter()
    while environment.taken < FEWEST * task.file.steps and time.perf_counter() - began < _SPEED_SECONDS:
        environment.step(policy.act(nothing))
    lasted = time.perf_counter() - began
    return (began - making) / FEWEST, lasted * task.file.steps / environment.taken


def _is_flag(task: Task, name: str) -> bool:
    """Whether it is an entry of the info that is 0 or 1: random actions may never reach a success."""
    if not isinstance(task.dynamics, GymTask):
        return False
    text = task.file.signals[name].expression or name
    return text in task.source.expressions.from_info and task.file.box[name] == (0, 1)


def of_search(nearest: Nearest | None) -> str:
    """The outcome of a search for a witness in words; `nearest` is None if there was no search."""
    if nearest is None:
        return "no witness was searched: an episode takes too long for the minutes"
    tried = f"{nearest.episodes} episodes of held actions from one start"
    if nearest.satisfies:
        return f"a witness exists: {tried} found a robustness of {nearest.robustness:.3g}"
    return f"no witness was found: {tried} reach at most {nearest.robustness:.3g}; others may satisfy"


def of_course(task: Task, nearest: Nearest) -> str | None:
    """A warning where the actions of a witness satisfy from most starts, so that no policy needs to look."""
    starts = len(task.starts.report_and_selection()[0])
    when = in_pieces(task.file.decisions, nearest.pool.shape[1])
    episodes = replay(task, nearest.pool[np.zeros(starts, dtype=np.int64)][:, when])
    share = referee.score(task, episodes.traces, lasted=episodes.lasted).satisfaction
    if share < LEARNED:
        return None
    return f"trivial: by one fixed sequence of actions {100 * share:.0f} % of the starts satisfy"


def doubts(task: Task) -> Iterator[str]:
    """Notes that a policy refutes which satisfies."""
    if reason := why_impossible(task.formula, task.file.box):  # else it was said before the task file was written
        yield f"impossible, if the ranges that random actions show are right: {reason}"
    if (warning := too_fast(task)) is not None:
        yield warning


def notes(task: Task, found: baselines.Constants, random: Score, repeatable: bool) -> Iterator[str]:
    """Notes that hold whatever a policy reaches."""
    if not repeatable:
        yield "the environment ignores seeds: no episode can be repeated, so no counterexample is searched"
    action = ", ".join(f"{value:.3g}" for value in found.action)
    tried = {"the action zero": found.zero, f"the constant action {action}": found.best, "random actions": random}
    for name, score in tried.items():
        if score.satisfaction >= LEARNED:
            yield f"trivial: by {name} {100 * score.satisfaction:.0f} % of the starts satisfy"
    if random.ended_early:
        meaning = {
            "hold": "the last sample then stays to the end of the episode",
            "violated": "the formula is then violated",
            "interval": "the formula is then satisfied if every continuation satisfies it",
        }[task.file.terminated]
        yield f"the environment ended {100 * random.ended_early:.0f} % of random episodes early: {meaning}"
