"""A task with a reward method as a process in time: the one place where transitions are made, where episodes begin
and end, and the model of them that a planner is given.

`Simulator` runs N copies from given states to the end. `BatchEnvironment` puts fresh initial states where an episode
ended; agents train on it. `stlbench.gym` shows the same through Gymnasium's interface.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract import ActionGrid, Array, End, Event, Integers, Model, RewardMethod, Transition, Truth, World
from stlbench.simulation import faults
from stlbench.simulation.verdicts import EarlyEnds
from stlbench.simulation.worlds import Moment, make_world, scaled_times, time_and_inputs
from stlbench.stl import Formula
from stlbench.task.entry import Region
from stlbench.task.file import LOST, VIOLATION, Near
from stlbench.task.starts import sampled_states
from stlbench.task.task import Task

_TRIED = 4096
_NEAR = 0.5
"""The share of drawn states that fulfil a condition of `near`. The others keep the whole region in view."""


def fulfilling(task: Task, region: Region, conditions: Sequence[Formula]) -> list[Array]:
    """For each condition on the signals the states (n, k) that fulfil it, of 4096 from a region, always the same."""
    if not conditions:
        return []
    states = sampled_states(task.system, region, np.random.default_rng(0), _TRIED)
    signals = task.system.signals(states)
    return [states[stl.holds(condition, task.signals)(signals)] for condition in conditions]


class ExploringStates:
    """Draws states from the region `exploring.states`, half of them where `exploring.near` says."""

    def __init__(self, task: Task, region: Region, near: Sequence[Near]) -> None:
        """A condition that no state fulfils is left out."""
        self._task, self._region = task, region
        found = zip(near, fulfilling(task, region, [each.where for each in near]), strict=True)
        self._near = sorted(((each.until, states) for each, states in found if len(states)), key=lambda pair: pair[0])
        self._ends = np.array([until for until, _ in self._near])

    def draw(self, generator: np.random.Generator, t: Integers) -> Array:
        """States (count, k) for episodes that begin at the times (count,). All randomness is the generator's."""
        states = sampled_states(self._task.system, self._region, generator, len(t))
        if self._near:
            for row in np.flatnonzero(generator.random(len(t)) < _NEAR):
                following = self._ends[self._ends >= t[row]]
                if following.size:  # one of those that end first, among the conditions that still stand
                    fulfil = self._near[generator.choice(np.flatnonzero(self._ends == following[0]))][1]
                    states[row] = fulfil[generator.integers(len(fulfil))]
        return states


_STARTS = 256
"""States that show a planner which memories an episode can begin with."""


def model_of(task: Task, method: RewardMethod) -> Model:
    """The dynamics and the reward as pure functions, under the rules by which training episodes go on."""
    file, generator = task.file, np.random.default_rng(0)
    return Model(
        system=task.system,
        method=method,
        formula=task.formula,
        actions=task.actions,
        steps=file.steps,
        hold=file.hold,
        cuts=file.training.cuts,
        ends=ends_of(task, method),
        starts=task.starts.of_training(generator, _STARTS),
    )


def ends_of(task: Task, method: RewardMethod) -> tuple[End, ...]:
    """The ends of a task in the order in which they count; one for each term where the task names violations.

    All pay the method's floor. A payout in the task file would favour some of the methods, as their units differ.
    """
    return tuple(_ends(task, method.floor / method.scale))


def _ends(task: Task, reward: float) -> Iterator[End]:
    specification, t = task.specification, np.arange(task.file.steps + 1)
    for ending in task.file.training.ends:
        if isinstance(ending.where, stl.Formula):
            yield End(specification.holds(ending.where), np.ones_like(t, dtype=np.bool_), reward)
        for term in specification.terms if ending.where == VIOLATION else ():
            if term.kind == "G":
                active = (term.start <= t) & (t <= term.end)
                yield End(specification.holds(stl.Not(term.psi)), active, reward)


def first_end(ends: Sequence[End], samples: Array, t: Integers) -> tuple[Truth, Array]:
    """Samples (N, h, k) whose last are at steps t (N,) -> whether it is over (N,), and what is paid then (N,)."""
    at = t[:, None] + np.arange(1 - samples.shape[1], 1)
    over, paid = np.zeros(len(samples), dtype=np.bool_), np.zeros(len(samples))
    for end in ends:
        now = end.active[at]
        if now.any():
            here = (now & end.over(samples)).any(axis=1) & ~over
            over |= here
            paid[here] = end.reward
    return over, paid


class Steps(NamedTuple):
    """The events while one action was held."""

    reward: Array  # (N,), the mean of the method's rewards over the steps
    samples: Array  # (N, hold, k): the signals after each step


class Simulator:
    """N copies of a task with a method's memory, all at their own time, without restarts."""

    def __init__(self, task: Task, method: RewardMethod, rewarded: bool = True, *, drawn: bool = False) -> None:
        """Args: `rewarded` False makes the rewards of a method without memory NaN; `drawn` see `make_world`."""
        self.task, self.method, self._drawn = task, method, drawn
        self._rewarded = rewarded or method.memory_size > 0  # a policy sees the memory, whoever reads the rewards
        self.horizon, self.hold = task.file.steps, task.file.hold
        actions = task.actions
        self._vectors = actions.vectors if isinstance(actions, ActionGrid) else np.empty((0, len(actions.names)))
        self._low, self._high = np.array(actions.low), np.array(actions.high)
        self._times = scaled_times(self.horizon)

    @property
    def state(self) -> Array:
        return self.world.state

    @property
    def signals(self) -> Array:
        return self.world.signals

    def reset(self, begun: Array) -> Array:
        """Begin an episode at each of the starts (N, s), states or seeds. Returns the first observation (N, D)."""
        self.world: World = make_world(self.task, len(begun), drawn=self._drawn)
        self.world.restart(np.arange(len(begun)), begun)
        faults.check_signals(self.task, self.signals, len(begun))
        self.t: Integers = np.zeros(len(begun), dtype=np.int64)
        self.memory = faults.begin(self.method, self.signals, self.t)
        return self.observe()

    def reset_rows(self, rows: Integers, begun: Array, t: Integers) -> None:
        """Begin new episodes in the given rows (r,), increasing, at the starts (r, s) and at steps t (r,)."""
        self.world.restart(rows, begun)
        self.t[rows] = t
        if self.method.memory_size:
            self.memory = self.memory.copy()  # a method may have returned what `_Taken` keeps
            self.memory[rows] = faults.begin(self.method, self.signals[rows], t)

    def observe(self) -> Array:
        """The view of a policy: the task's features, the time, the inputs: (N, D)."""
        return self.observed(self.moment())

    def moment(self, rows: Integers | Truth | None = None, t: Integers | None = None) -> Moment:
        """The parts of the observations of all copies, or of some: at their own time, or at t (N,)."""
        t = self.t if t is None else t
        parts = (self.world.features(t), self.world.signals, t, self.memory)
        return Moment(*parts if rows is None else (part[rows] for part in parts))

    def observed(self, moment: Moment) -> Array:
        """The observations (n, D)."""
        numbers = moment.numbers(self.task)
        parts = [numbers, *time_and_inputs(self.method, self._times, moment.t, moment.memory)]
        return faults.observation(self.task, self.method, parts, moment.t)

    def advance(self, action: Integers | Array) -> Steps:
        """Hold actions for `hold` steps: indices (N,) of the grid, or vectors (N, axes), clipped to their ends."""
        faults.check_action(self.task.actions, action, self.t)
        vectors: Array = self._vectors[action] if action.dtype.kind == "i" else action.clip(self._low, self._high)
        samples, self.last_action = self.world.advance(vectors, self.hold), vectors
        faults.check_samples(self.task, samples, self.hold, self.t)
        self.last_samples = samples
        if self._rewarded:
            reward, self.memory = self.paid(samples, vectors, self.t, self.memory)
        else:
            reward = np.full(len(vectors), np.nan)
        self.t = self.t + self.hold  # not in place: `_Taken` keeps the times before
        return Steps(reward, samples[1:].transpose(1, 0, 2))

    def paid(self, samples: Array, vectors: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """The method's mean reward (N,) for samples (hold + 1, N, k) from a memory on, and the memory after."""
        rewards, memory = faults.pay(self.method, samples, vectors, t, memory)
        mean: Array = rewards[0] if self.hold == 1 else rewards.mean(axis=0)
        return mean, memory

    def over(self, memory: Array) -> Truth:
        """Which memories (N, m) the method says are over; it is one that can end."""
        over = self.method.over(memory)
        faults.check_over(self.method, over, len(memory))
        return over


class _StepEnd(NamedTuple):
    """The end of a step for N copies, whatever the memory of the method."""

    fixed: Truth  # (N,): the task or the world ended the episode. Its reward and event do not depend on the memory
    event: NDArray[np.int8]  # (N,), each an `Event`


class _Taken(NamedTuple):
    """The last step of N copies, for `counterfactual`."""

    observation: Array  # (N, D), before it
    t: Integers  # (N,), before it
    memory: Array  # (N, m), before it
    transition: Transition
    end: _StepEnd


class _Past:
    """The samples of N episodes so far, from step 0 on, by which an episode is lost."""

    def __init__(self, task: Task, count: int) -> None:
        self._formula, self._names = task.formula, task.signals
        self._samples: Array = np.empty((count, task.file.steps + 1, len(task.signals)))

    def begin(self, rows: Integers | slice, signals: Array) -> None:
        """Episodes begin in rows (r,), at any step, as if the signals (r, k) had been there since step 0."""
        self._samples[rows] = signals[:, None]

    def add(self, samples: Array, t: Integers) -> None:
        """Samples (N, h, k), the last of which are at steps t (N,)."""
        at = t[:, None] + np.arange(1 - samples.shape[1], 1)
        self._samples[np.arange(len(t))[:, None], at] = samples

    def lost(self, ended: Truth, t: Integers) -> Truth:
        """Those copies (N,) that ended at steps t (N,) and violate with the last sample held."""
        lost, rows = ended.copy(), np.flatnonzero(ended)
        held = np.minimum(np.arange(self._samples.shape[1]), t[rows, None])
        lost[rows] = ~stl.satisfied(self._formula, self._samples[rows[:, None], held], self._names)
        return lost


class BatchEnvironment:
    """N copies that restart by themselves (`contract.Environment`), by the rules of `TaskFile.training`."""

    def __init__(self, task: Task, method: RewardMethod, count: int, seed: int) -> None:
        self.task, self.count = task, count
        self.actions, self.hold = task.actions, task.file.hold
        self.simulator = Simulator(task, method)
        self._training, horizon = task.file.training, task.file.steps
        self._events = np.full(horizon + 1, Event.GOES_ON, dtype=np.int8)
        self._events[list(self._training.cuts)], self._events[horizon] = Event.CUT, Event.TIME_LIMIT
        self._nothing_follows = Event.OVER if method.can_end else Event.END
        self._ends, self._early_ends = ends_of(task, method), EarlyEnds(method, task.file.terminated)
        if (exploring := self._training.exploring) is not None and exploring.states is not None:
            self._exploring_states = ExploringStates(task, exploring.states, exploring.near)
        self._floor = method.floor / method.scale
        self._past = _Past(task, count) if any(end.where == LOST for end in self._training.ends) else None
        self.counterfactuals = method.counterfactuals
        self._generator = np.random.default_rng(seed)
        self.taken, self.decisions = 0, task.file.decisions
        self.observation_size = self.reset().shape[1]
        self.time_column = self.observation_size - method.input_size - 1
        self._generator = np.random.default_rng(seed)  # again: a reset for sizes alone must not change the starts

    def reset(self, alike: int = 1) -> Array:
        self._broken_off: Integers = np.full(self.count, self.simulator.horizon)
        self.simulator.reset(np.repeat(self._draw(self.count // alike), alike, axis=0))
        if self._past is not None:
            self._past.begin(slice(None), self.simulator.signals)
        if self._training.exploring is not None and alike == 1:
            self._reset_rows(np.arange(self.count))
        self._seen = self.simulator.observe()
        return self._seen

    def step(self, action: Integers | Array) -> Transition:
        """Hold the actions for `hold` steps (see `contract.Environment`); rows whose episode is over are reset."""
        simulator, before = self.simulator, (self._seen, self.simulator.t, self.simulator.memory)
        held = simulator.advance(action)
        self.taken += self.count * self.hold
        reward = held.reward / simulator.method.scale
        end, t = self._step_end(reward, held.samples), simulator.t
        event = self._outcome(simulator.memory, end)
        boundary, ended = self._events[t] == Event.CUT, event >= Event.TIME_LIMIT
        arrived, observation = self._seen_at(boundary, ended)
        transition = Transition(observation, reward, arrived, event)
        if self.counterfactuals:
            self._seen, self._taken = observation, _Taken(*before, transition, end)
        return transition

    def _seen_at(self, boundary: Truth, ended: Truth) -> tuple[Array, Array]:
        """The observations (N, D) that the step arrives at, and those after a reset of the copies that ended.

        Beyond a boundary the reward asks for something else. So a copy arrives there at the time of the decision
        before: the value is that of going on as before. All observations are made at once, as the formula's view costs
        by the call.
        """
        simulator = self.simulator
        moments = [simulator.moment(np.arange(self.count))]  # a copy, as a reset changes the world in place
        if boundary.any():
            moments.append(simulator.moment(boundary, simulator.t - self.hold))
        if ended.any():
            self._reset_rows(np.flatnonzero(ended))
            moments.append(simulator.moment(ended))
        if len(moments) == 1:
            seen = simulator.observed(moments[0])
            return seen, seen
        seen = simulator.observed(Moment(*map(np.concatenate, zip(*moments, strict=True))))
        now = seen[: self.count]
        arrived, observation = now.copy(), now.copy()
        arrived[boundary] = seen[self.count : self.count + int(boundary.sum())]
        observation[ended] = seen[len(seen) - int(ended.sum()) :]
        return arrived, observation

    def counterfactual(self, generator: np.random.Generator) -> tuple[Array, Transition]:
        """The last step with other memories (see `contract.Environment`)."""
        simulator, method, taken = self.simulator, self.simulator.method, self._taken
        samples, fixed = simulator.last_samples, taken.end.fixed
        numbers = generator.random(taken.memory.shape)
        given = faults.own(samples[0]), faults.own(taken.t), faults.own(taken.memory)
        other = method.counterfactual(*given, numbers)
        faults.check_memory(method, other, taken.t)
        memory = np.where(fixed[:, None], taken.memory, other)
        reward, after = simulator.paid(samples, simulator.last_action, taken.t, memory)
        transition = taken.transition._replace(
            reward=np.where(fixed, taken.transition.reward, reward / method.scale),
            arrived=_with_inputs(method, taken.transition.arrived, after),
            event=np.maximum(self._outcome(after, taken.end), np.int8(Event.CUT)),  # the next step has another memory
        )
        return _with_inputs(method, taken.observation, memory), transition

    def _step_end(self, reward: Array, samples: Array) -> _StepEnd:
        """The end of a step with samples (N, hold, k). Pays, in place, the copies that the task or the world ended."""
        simulator, t = self.simulator, self.simulator.t
        fixed, event = np.zeros(self.count, dtype=np.bool_), self._events[t]
        event[t >= self._broken_off] = Event.TIME_LIMIT
        if self._ends:
            fixed, paid = first_end(self._ends, samples, t)
            reward[fixed], event[fixed] = paid[fixed], self._nothing_follows
        if self._past is not None:
            self._past.add(samples, t)
        if simulator.world.can_end and (stopped := simulator.world.ended & (event < Event.TIME_LIMIT)).any():
            fixed, event[stopped] = fixed | stopped, Event.TIME_LIMIT
            if self._past is not None:
                lost = self._past.lost(stopped, t)
                reward[lost], event[lost] = self._floor, self._nothing_follows
                stopped &= ~lost
            if self.task.file.terminated != "interval":  # nobody knows what would follow: going on is worth the same
                self._pay_stopped(np.flatnonzero(stopped), reward)
                event[stopped] = self._nothing_follows
        return _StepEnd(fixed, event)

    def _pay_stopped(self, rows: Integers, reward: Array) -> None:
        simulator, method = self.simulator, self.simulator.method
        for row in rows:
            t, last, memory = int(simulator.t[row]), simulator.signals[row], simulator.memory[[row]]
            left = self._early_ends.sum_left(last, simulator.last_action[[row]], t, memory) / method.scale
            # `OVER` counts once, so all that is left is paid now; `END` counts for ever, so it has the mean of a step
            reward[row] = reward[row] + left / self.hold if method.can_end else left / (simulator.horizon - t)

    def _outcome(self, memory: Array, end: _StepEnd) -> NDArray[np.int8]:
        """The events (N,) of a step to these memories (N, m) of the method."""
        over = self.simulator.method.can_end and self.simulator.over(memory)
        return np.where(over, np.int8(Event.OVER), end.event)

    def _reset_rows(self, rows: Integers) -> None:
        simulator, exploring = self.simulator, self._training.exploring
        begun, t = self._draw(len(rows)), np.zeros(len(rows), dtype=np.int64)
        self._broken_off[rows] = simulator.horizon
        if exploring is not None:
            chosen = np.flatnonzero(self._generator.random(len(rows)) < exploring.share)
            t[chosen] = self._generator.integers(self.decisions, size=len(chosen)) * self.hold
            kept = self._generator.random(len(chosen)) < exploring.kept
            if kept.any():  # the state of an environment cannot be set, and has no entries
                begun[chosen[kept]] = simulator.state[rows[chosen[kept]]]
            if exploring.states is not None:
                drawn = chosen[~kept]
                begun[drawn] = self._exploring_states.draw(self._generator, t[drawn])
            if exploring.length is not None:
                length = self._generator.integers(1, 2 * exploring.length, size=len(chosen)) * self.hold
                self._broken_off[rows[chosen]] = np.minimum(t[chosen] + length, simulator.horizon)
        simulator.reset_rows(rows, begun, t)
        if self._past is not None:
            self._past.begin(rows, simulator.signals[rows])

    def _draw(self, count: int) -> Array:
        return self.task.starts.of_training(self._generator, count)


def _with_inputs(method: RewardMethod, observation: Array, memory: Array) -> Array:
    """Observations (N, D), with the method's inputs for other memories (N, m) in the last columns."""
    changed = observation.copy()
    changed[:, observation.shape[1] - method.input_size :] = method.inputs(memory)
    return changed
