"""The referee: lets policies act from fixed starts, scores the recorded traces with the task's formula, and selects
the best checkpoint.

Every reported robustness comes from here. No reward enters a score. A method only gives the policy its inputs.

The better one of two checkpoints satisfies from more starts. If they satisfy from as many, it has the larger mean
robustness. Scoring all checkpoints from all starts can take longer than the training. In a race all are scored from
the same few starts. Then those that are clearly behind the leader leave, and the others go on to more starts.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from stlbench import stl
from stlbench.contract import Array, GymTask, Integers, Policy, RewardMethod, StatePolicy, Truth
from stlbench.errors import UsageError
from stlbench.records.array_files import Assessment, Film, read_cell
from stlbench.records.result import MAIN, RANDOM, Result, Score
from stlbench.simulation.environment import Simulator
from stlbench.simulation.faults import PluginFault, array_of_actions
from stlbench.simulation.verdicts import OPEN, first_failed, judge, without_end
from stlbench.task.task import Task


@dataclass(frozen=True)
class Recording:
    """Traces of one policy, or of several seeds' policies in turn, from the report's starts."""

    traces: Array  # (N, T + 1, k)
    seeds: int
    film: Film | None = None  # a single cell has one, unless an older version recorded it

    def evenly(self, count: int) -> Array:
        chosen = np.unique(np.linspace(0, len(self.traces) - 1, count).round().astype(np.int64))
        return self.traces[chosen]


def load(task: Task, result: Result, run: Path) -> Recording:
    """The recording of a finished cell. Raises `UsageError` where it is damaged, missing, or of another version."""
    saved = read_cell(run, result)
    if saved.names != task.signals or saved.samples.shape[1] != task.file.steps + 1:
        raise UsageError(f"the traces of {result.id.name} are of another version of the task {task.name}")
    return Recording(saved.samples, 1, saved.film)


def gather(recordings: Sequence[Recording]) -> Recording:
    return Recording(np.concatenate([recording.traces for recording in recordings]), len(recordings))


_FIRST = 8  # starts of the first round, or an eighth of them, whichever is more; each round doubles their number
_SURE = 3.0  # a checkpoint leaves if it is behind by more than so many standard errors of the difference
_SAFE = 5.0
"""A leader that satisfied from all starts so far may still fail from a rare one. It is settled that it will not if its
mean robustness is more than so many standard deviations over starts above 0. With these numbers the race chose the
same checkpoint as all starts do, in the recorded scores of 13 cells."""


class Race(NamedTuple):
    """The result for K checkpoints."""

    best: int
    starts: Integers  # (K,): from how many of the starts each was scored
    satisfaction: Array  # (K,): over these
    robustness_mean: Array  # (K,): over these


def race(play: Callable[[Integers, slice], tuple[Truth, Array]], checkpoints: int, starts: int) -> Race:
    """Find the best of K checkpoints, of equals the first.

    After a round of n starts, a checkpoint leaves if it is behind the leader by more than 3 standard errors.
    Satisfaction is compared, start by start. If two satisfied from the same starts, robustness is compared, once
    satisfaction is settled. It is settled if the leader satisfied from no start. It is also settled if the leader
    satisfied from all, n is at least N / 2, and its mean robustness is more than 5 standard deviations above 0.

    The standard error is that of a mean over n of N starts, which falls to 0 at n = N. So among checkpoints that are
    never clearly behind, the race finds the best exactly.

    Args:
        play: checkpoints (k,) and a part of the starts -> satisfied and robustness, (k, part) each.
        checkpoints: K, at least 1.
        starts: N; any first part of them must be as even as the whole, as that of a Halton sequence is.
    """
    satisfied, robustness = np.zeros((checkpoints, starts)), np.zeros((checkpoints, starts))
    scored, left = np.zeros(checkpoints, dtype=np.int64), np.arange(checkpoints)
    for part in _rounds(starts):
        satisfied[left, part], robustness[left, part] = play(left, part)
        scored[left] = n = part.stop
        left = left[~_behind(satisfied[left, :n], robustness[left, :n], starts)]
        if len(left) == 1:
            break
    return Race(
        int(left[_leader(satisfied[left], robustness[left])]),
        scored,
        satisfied.sum(axis=1) / scored,
        robustness.sum(axis=1) / scored,
    )


def _rounds(starts: int) -> Iterator[slice]:
    begin, end = 0, max(_FIRST, -(-starts // 8))
    while begin < starts:
        yield slice(begin, min(end, starts))
        begin, end = end, 2 * end


def _leader(satisfied: Array, robustness: Array) -> int:
    """The row of the best of k checkpoints by the same starts, both (k, n)."""
    counts, means = satisfied.sum(axis=1), robustness.mean(axis=1)
    return max(range(len(counts)), key=lambda row: (counts[row], means[row]))


def _behind(satisfied: Array, robustness: Array, starts: int) -> Truth:
    """Which of k checkpoints (k,) are clearly behind their leader by n of the starts, both (k, n)."""
    leader, n = _leader(satisfied, robustness), satisfied.shape[1]
    by_verdict = satisfied[leader] - satisfied
    alike = ~by_verdict.any(axis=1)
    with np.errstate(invalid="ignore"):  # robustness may be infinite
        ahead = np.where(alike[:, None], robustness[leader] - robustness, by_verdict)
        error = _spread(ahead) * np.sqrt(1 / n - 1 / starts)
        clearly: Truth = ahead.mean(axis=1) > _SURE * error
        safe = robustness[leader].mean() > _SAFE * _spread(robustness[leader])
    reliable = 2 * n >= starts and satisfied[leader].all() and safe
    settled = n == starts or reliable or not satisfied[leader].any()
    leaves: Truth = clearly & (~alike | settled)
    return leaves


def _spread(values: Array) -> Array:
    """The standard deviation along the last axis; infinite for one value."""
    spread: Array = values.std(axis=-1, ddof=1) if values.shape[-1] > 1 else np.full(values.shape[:-1], np.inf)
    return spread


class Episodes(NamedTuple):
    traces: Array
    """(N, T + 1, k): the signals. After an early end the last sample stays, or there is NaN, as the task says."""
    lasted: Integers  # (N,): the last step at which the environment went on: T, but where it ended the episode before


def record(
    task: Task, method: RewardMethod, policy: Policy | StatePolicy, begun: Array, visited: list[Array] | None = None
) -> Episodes:
    """The episodes when `policy` acts from the starts (N, s) to the last step.

    If `visited` is given, it gets the states at each decision and at the end, (N, n) each.
    """
    few = len(begun) <= at_once(task) or not isinstance(task.dynamics, GymTask)
    parts = [begun] if few else np.array_split(begun, -(-len(begun) // at_once(task)))
    each: list[list[Array]] = [[] for _ in parts]
    episodes = [simulate(task, method, _acting(policy), part, seen) for part, seen in zip(parts, each, strict=True)]
    if visited is not None:
        visited += [np.concatenate(seen) for seen in zip(*each, strict=True)]
    return Episodes(*map(np.concatenate, zip(*episodes, strict=True))) if len(episodes) > 1 else episodes[0]


def _acting(policy: Policy | StatePolicy) -> Callable[[Simulator], Integers | Array]:
    if isinstance(policy, StatePolicy):
        act = policy.episode()
        if not callable(act):
            raise PluginFault(f"the agent's policy: episode gives {type(act).__name__}, the contract says a function")
        return lambda at: act(at.state, at.t, at.memory)
    return lambda at: policy.act(at.observe())


def at_once(task: Task) -> int:
    """How many copies are simulated at a time. More of a system fill memory; each of an environment has to be made."""
    return 64 if isinstance(task.dynamics, GymTask) else 1024


def simulate(
    task: Task,
    method: RewardMethod,
    act: Callable[[Simulator], Integers | Array],
    begun: Array,
    visited: list[Array] | None = None,
) -> Episodes:
    """As `record`, where `act` decides: indices (N,) of the grid, or vectors (N, axes)."""
    simulator = Simulator(task, method, rewarded=False)
    simulator.reset(begun)
    trace = np.empty((len(begun), task.file.steps + 1, len(task.signals)))
    trace[:, 0] = simulator.signals
    if visited is not None:
        visited.append(simulator.state)
    for t in range(0, task.file.steps, simulator.hold):
        trace[:, t + 1 : t + 1 + simulator.hold] = simulator.advance(act(simulator)).samples
        if visited is not None:
            visited.append(simulator.state)
    world, lasted = simulator.world, np.full(len(begun), task.file.steps)
    if world.can_end:
        lasted = np.where(world.ended, world.lived, lasted)
        if task.file.terminated != "hold":
            trace = without_end(trace, lasted)
    return Episodes(trace, lasted)


def score(task: Task, traces: Array, formula: stl.Formula | None = None, *, lasted: Integers | None = None) -> Score:
    """Robustness and Boolean satisfaction of the task's or another formula on traces (N, T + 1, k) at t = 0.

    After an early end the lower end of an interval counts: satisfied means so by every continuation.
    `lasted` (N,) is that of `Episodes`; without it, the share of early ends is unknown.
    """
    formula = task.formula if formula is None else formula
    verdicts = judge(formula, traces, task.specification, task.file.terminated)
    satisfied, open_ = verdicts.satisfied[:, 0], verdicts.satisfied[:, 0] != verdicts.satisfied[:, 1]
    failed = first_failed(formula, traces[~satisfied & ~open_], task.signals)
    failed[OPEN] = int(open_.sum())
    return Score(
        robustness=tuple(verdicts.robustness[:, 0].tolist()),
        satisfied=tuple(satisfied.tolist()),
        first_failed={part: count for part, count in failed.items() if count},
        ended_early=None if lasted is None else float(np.mean(lasted < stl.horizon(formula))),
    )


@dataclass(frozen=True)
class _Crowd(Policy):
    """Several policies as one: each acts for its equal share of the copies."""

    policies: Sequence[Policy]

    def act(self, observation: Array) -> Integers | Array:
        shares = np.split(observation, len(self.policies))
        acted: list[Any] = [policy.act(share) for policy, share in zip(self.policies, shares, strict=True)]
        together: Integers | Array = np.concatenate(list(map(array_of_actions, acted)))
        return together


def _crowds(policies: Sequence[Policy | StatePolicy], most: int) -> Iterator[tuple[Policy | StatePolicy, int]]:
    """Groups of policies that are simulated side by side, and their sizes; policies that act on states stand alone."""
    learned = [policy for policy in policies if isinstance(policy, Policy)]
    if len(learned) < len(policies):
        yield from ((policy, 1) for policy in policies)
        return
    for first in range(0, len(learned), most):
        crowd = _Crowd(learned[first : first + most])
        yield crowd, len(crowd.policies)


def _means(satisfied: Truth, robustness: Array) -> tuple[float, float]:
    return float(satisfied.mean()), float(robustness.mean())


_FEW = 8  # starts of a glance, about


class Referee:
    """Scores the policies of one cell: checkpoints for selection, then the report.

    Args:
        task: the task, with its protocols.
        method: gives the policy its inputs.
        random_starts: how many random starts the report has beside the grid. They are the same for every method and
            seed of a task, and neither training nor selection sees them.
    """

    def __init__(self, task: Task, method: RewardMethod, random_starts: int = 0) -> None:
        self.task, self.method = task, method
        reported, self._selection = task.starts.report_and_selection()
        self._protocols = {MAIN: (task.formula, reported)}  # the formula in steps, and where policies start
        if random_starts:
            self._protocols[RANDOM] = task.formula, task.starts.at_random(random_starts)
        for name, protocol in task.file.protocols.items():
            formula = task.formula if protocol.formula is None else protocol.formula
            self._protocols[name] = formula, task.starts.of_protocol(protocol)
        self._selected = dict[int, tuple[Policy | StatePolicy, Truth, Array]]()

    def select(self, policy: Policy | StatePolicy) -> tuple[float, float]:
        """Satisfaction and mean robustness from the starts for selection, which share no state with the report's.

        `choose` does not play such a policy again.
        """
        satisfied, robustness = self._verdicts([policy], self._selection)
        self._selected[id(policy)] = policy, satisfied[0], robustness[0]
        return _means(satisfied, robustness)

    def glance(self, policy: Policy | StatePolicy) -> tuple[float, float]:
        """As `select`, from a few of these starts, while a training goes on."""
        return _means(*self._verdicts([policy], self._selection[:: max(1, len(self._selection) // _FEW)]))

    def look(self, policy: Policy | StatePolicy) -> tuple[float, float]:
        """As `glance`, but from all of these starts where it satisfies from the few."""
        few = self.glance(policy)
        return self.select(policy) if few[0] == 1 else few

    def choose(self, policies: Sequence[Policy | StatePolicy], most: int | None = None) -> Race:
        """The best of the checkpoints (K,), by a race on the starts for selection, or on the first `most` of them.

        Checkpoints in the race are simulated side by side. The best is scored from all of these starts, as in other
        cells.
        """
        begun = self._selection[:most]

        def play(which: Integers, part: slice) -> tuple[Truth, Array]:
            left = [policies[i] for i in which if id(policies[i]) not in self._selected]
            played = iter(zip(*self._verdicts(left, begun[part]), strict=True)) if left else iter(())
            known = (self._selected.get(id(policies[i])) for i in which)
            rows = [next(played) if each is None else (each[1][part], each[2][part]) for each in known]
            return np.stack([row for row, _ in rows]), np.stack([row for _, row in rows])

        result = race(play, len(policies), len(begun))
        best = result.best
        if result.starts[best] < len(begun):
            means = _means(*play(np.array([best]), slice(0, len(begun))))
            result.satisfaction[best], result.robustness_mean[best] = means
            result.starts[best] = len(begun)
        return result

    def _verdicts(self, policies: Sequence[Policy | StatePolicy], states: Array) -> tuple[Truth, Array]:
        """Satisfaction and robustness (k, n) of each of k policies from each of n starts."""
        together = max(1, at_once(self.task) // len(states))
        satisfied, robustness = [], []
        for crowd, count in _crowds(policies, together):
            traces = record(self.task, self.method, crowd, np.tile(states, (count, 1))).traces
            verdicts = judge(self.task.formula, traces, self.task.specification, self.task.file.terminated)
            satisfied.append(verdicts.satisfied[:, 0])
            robustness.append(verdicts.robustness[:, 0])
        shape = len(policies), len(states)
        return np.concatenate(satisfied).reshape(shape), np.concatenate(robustness).reshape(shape)

    def assess(self, policy: Policy | StatePolicy) -> Assessment:
        """The scores of all protocols, from the report's starts."""
        visited, begun = list[Array](), [starts for _, starts in self._protocols.values()]
        episodes = record(self.task, self.method, policy, np.concatenate(begun), visited)
        scores, first = dict[str, Score](), 0
        for name, (formula, starts) in self._protocols.items():
            part = slice(first, first + len(starts))
            first = part.stop
            scores[name] = score(self.task, episodes.traces[part], formula, lasted=episodes.lasted[part])
        if RANDOM in scores:
            scores[RANDOM] = scores[RANDOM].summarised()
        reported = len(begun[0])
        return Assessment(scores, episodes.traces[:reported], np.stack(visited, axis=1)[:reported])
