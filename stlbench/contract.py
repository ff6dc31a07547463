"""The contract: what a plugin author reads. A plugin imports nothing else of stlbench but `stlbench.stl`, and
`stlbench.presentation` if it has something to show.

Four kinds of plugin, each found by its entry-point group and named by its entry point:

- `stlbench.methods`, a `RewardMethod` subclass: the reward of a transition, and its own memory;
- `stlbench.tasks`, a `System` subclass: dynamics, beside a `task.yaml` in its package; or a `GymTask` or
  `WorldTask` subclass, where starts are seeds;
- `stlbench.agents`, an `Agent` subclass: training, environment in, policy out;
- `stlbench.executors`, an `Executor` subclass: cells run in processes, here or on a cluster.

Conventions, everywhere: arrays are NumPy float64 and batched, rows first. `N` is the number of copies that run in
lock-step, `n` the state's size, `k` the number of signals, `m` the memory's size, `D` the observation's. Time is a
step count: a trace of an episode has samples 0..T, transition t leads from sample t to sample t + 1, so t is 0 at
the first transition and T - 1 at the last. One step lasts the task's sampling time, in seconds.

Parameters of a plugin are the keyword-only arguments of its constructor, with annotations and defaults, such as those
of a `dataclass(frozen=True, kw_only=True)`. The harness checks what a user writes (`funnel[variant=code,ginf=0.02]`)
against the annotations, so `Literal[...]`, `float`, `int`, `bool` and `str` give clear messages without any code.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, Literal, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from stlbench import stl
from stlbench.contract_parts import origin
from stlbench.contract_parts.actions import ActionBox, ActionGrid, Actions
from stlbench.contract_parts.environment_tasks import GymTask, WorldTask
from stlbench.contract_parts.executor import Executor, Outcome, Work
from stlbench.contract_parts.stepwise import along_by_steps, complete
from stlbench.contract_parts.texts import cause
from stlbench.contract_parts.world import World

__all__ = [
    "ActionBox",
    "ActionGrid",
    "Actions",
    "Agent",
    "Array",
    "Arrays",
    "Cost",
    "End",
    "Environment",
    "Executor",
    "GymTask",
    "Integers",
    "Intractable",
    "Model",
    "Outcome",
    "Policy",
    "RewardMethod",
    "Specification",
    "StatePolicy",
    "System",
    "Training",
    "Transition",
    "Truth",
    "Unsuitable",
    "Work",
    "World",
    "WorldTask",
    "cause",
]

if _problem := origin.foreign():
    raise ImportError(_problem)

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Truth = NDArray[np.bool_]
Arrays = Mapping[str, NDArray[Any]]
"""By name: numbers, or short texts, of any shape; no objects."""


class Intractable(Exception):
    """A method would make training too dear; the message says what it would take. Ends a cell as `intractable`."""


class Unsuitable(ValueError):
    """A method or agent cannot be applied to this task, or on this machine; the message says which rule is broken."""


# --------------------------------------------------------------------------------------------------- reward methods


@dataclass(frozen=True)
class Specification:
    """What a reward method knows about a task: the formula, and the signals it is read from.

    Intervals of the formulas are in steps. A method sees no system, no agent and no budget.
    """

    formula: stl.Formula
    """The task. Its robustness at t = 0 is what the referee measures."""
    signals: tuple[str, ...]
    """Names of the k signals, in the order of the columns that `RewardMethod.step` is given."""
    low: tuple[float, ...]
    """Lower end of each signal's range; with `high` the box S of the paper's rho_max = max over S."""
    high: tuple[float, ...]
    steps: int
    """T: transitions in an episode. T >= horizon of the formula."""
    dt: float
    """Sampling time in seconds."""
    nested: stl.Formula | None = None
    """The same task as one outer operator over a window, `G[0,190] G[0,10] psi`, where the task file gives one."""

    @cached_property
    def terms(self) -> tuple[stl.Term, ...]:
        """The conjunction of eq. 2 as terms F[a,b] psi, G[a,b] psi, F[a,c1] G[c2,b] psi.

        Raises `Unsuitable` where the formula is outside that fragment, with the place and the reason.
        """
        try:
            return stl.fragment(self.formula)
        except stl.FragmentError as error:
            raise Unsuitable(str(error)) from error

    def margin(self, psi: stl.Formula) -> Callable[[Array], Array]:
        """The robustness of `psi`, free of temporal operators, as a function of signals (..., k) -> (...)."""
        return stl.margin(psi, self.signals)

    def holds(self, psi: stl.Formula) -> Callable[[Array], Truth]:
        """The truth of `psi`, free of temporal operators, as a function of signals (..., k) -> (...)."""
        return stl.holds(psi, self.signals)

    def range(self, psi: stl.Formula) -> tuple[float, float]:
        """Sound bounds (rho_min, rho_max) of the robustness of `psi` over the box of the signals."""
        if psi not in self._ranges:
            box = {name: (low, high) for name, low, high in zip(self.signals, self.low, self.high, strict=True)}
            proven = stl.bounds(psi, box)
            self._ranges[psi] = proven.low, proven.high
        return self._ranges[psi]

    @cached_property
    def _ranges(self) -> dict[stl.Formula, tuple[float, float]]:
        """Those that were asked for, since every method asks for those of all terms."""
        return {}


class RewardMethod:
    """Turns a formula into the reward of each transition. Pure: the same arguments give the same reward.

    Subclass it, take the parameters as keyword-only arguments, and write one of three; the others follow from it:

    - `arrival`, where the reward is a function of the sample that is arrived at, and of time, alone;
    - `step`, the reward of one transition;
    - `along`, those of one held action at once, which can be faster than `step`.

    A method that must remember (flags, a history of states) sets `memory_size` and carries its memory along; the policy
    is shown `inputs(memory)`. A constructor raises `Unsuitable` where the formula or a parameter does not fit. It need
    not count its inputs: the harness refuses what makes training too dear (`Agent.cost`). For what tables and figures
    may show of a method, see `stlbench.presentation`.

    One transition t of N copies, signals s:

    ============  ======================  ======================  =========================
    at            the first, t = 0        a middle one            the last, t = T - 1
    ============  ======================  ======================  =========================
    signals       s_0                     s_t                     s_{T-1}
    next_signals  s_1                     s_{t+1}                 s_T, the end of the trace
    memory        `initial_memory(s_0)`   what `step` returned    what `step` returned
    ============  ======================  ======================  =========================

    So a reward of the paper, r'(s, t), is paid on arrival: r'(s_{t+1}, t + 1). The sample s_0 is never paid for, as no
    action can change it; every other sample of the trace is paid for once.
    """

    memory_size: int = 0
    """m: numbers that the method carries from step to step; 0 for a method without memory."""
    paid_on_arrival: ClassVar[bool] = False
    """Whether the class has written `arrival`; set by the contract itself."""
    scale: float = 1.0
    """About the largest magnitude of the reward. Training divides by it, for every method alike, so that one recipe
    of the agent serves methods whose rewards are metres and methods whose rewards are flags."""
    extension: str = ""
    """Why the task is outside the form that the method's source was published for, in a few words; empty inside it."""

    @property
    def floor(self) -> float:
        """The least that the method pays for a step, in its own unit: -`scale` unless it says otherwise.

        A training episode that ends early (`training.ends`) counts as if this were paid for ever after, so that no
        method is paid less for an end than for the worst that it knows, and none more.
        """
        return -self.scale

    @property
    def input_size(self) -> int:
        """How many `inputs` the policy is shown: `memory_size` unless the method says otherwise."""
        return self.memory_size

    def __init__(self, specification: Specification) -> None:
        self.specification = specification

    def __init_subclass__(cls, **options: Any) -> None:
        """Raises `TypeError` for a subclass that writes none of `arrival`, `step` and `along`, or more than one."""
        super().__init_subclass__(**options)
        complete(cls, RewardMethod)

    def initial_memory(self, signals: Array, t: Integers) -> Array:
        """The memory at the first sample of an episode: signals (N, k) at steps t (N,) -> (N, m). Zeros by default.

        t is 0 in every episode that is scored. Where a task trains with exploring starts (`training.exploring`),
        some episodes begin at a later time, with nothing known of what was before.
        """
        return np.zeros((len(signals), self.memory_size))

    def arrival(self, signals: Array, t: Integers) -> Array:
        """The reward of arriving at a sample, for a method without memory to which nothing else matters.

        What pays for samples alone can be planned for much faster than what pays for transitions (`Model`).

        Args:
            signals: s_t, (..., k), in the signals' units.
            t: step index of the sample, (...), each in 1..T; rows may be at different times.

        Returns:
            The rewards (...).
        """
        raise TypeError(f"{type(self).__name__} is not paid for samples alone: it has no arrival")

    def step(
        self, signals: Array, action: Array, next_signals: Array, t: Integers, memory: Array
    ) -> tuple[Array, Array]:
        """The reward of one transition, and the memory after it.

        Args:
            signals: s_t, (N, k), in the signals' units.
            action: what the system was given, (N, number of action axes), in the actions' units.
            next_signals: s_{t+1}, (N, k).
            t: step index of the transition, (N,), each in 0..T-1; rows may be at different times.
            memory: what `initial_memory` or the last `step` returned, (N, m). Not to be changed in place.

        Returns:
            The reward (N,) and the next memory (N, m).
        """
        if self.paid_on_arrival:
            return self.arrival(next_signals, t + 1), memory
        rewards, memory = self.along(np.stack([signals, next_signals]), action, t, memory)
        return rewards[0], memory

    def along(self, samples: Array, action: Array, t: Integers, memory: Array) -> tuple[Array, Array]:
        """The rewards while one action is held for h steps, the same as by `step` after `step`.

        Args:
            samples: s_t, ..., s_{t+h}, (h + 1, N, k).
            action: as for `step`, (N, number of action axes).
            t: step index of the first transition, (N,).
            memory: at s_t, (N, m). Not to be changed in place.

        Returns:
            The rewards (h, N) and the memory at s_{t+h}, (N, m).
        """
        if self.paid_on_arrival:
            return self.arrival(samples[1:], t + np.arange(1, len(samples))[:, None]), memory
        return along_by_steps(self, samples, action, t, memory)

    def inputs(self, memory: Array) -> Array:
        """What the policy sees of the memory, about in [-1, 1]: (N, m) -> (N, `input_size`). All of it by default."""
        return memory


# ------------------------------------------------------------------------------------------------------------ tasks


class System(ABC):
    """The dynamics of a task, N copies at once. Pure: NumPy in, NumPy out, no random numbers, no hidden state.

    The entry point names the class; the `task.yaml` beside its module says everything else: formula, signals and
    their ranges, actions, sampling time, initial states, recipes, budgets. `parameters` of that file arrive as
    keyword arguments.
    """

    state: ClassVar[tuple[str, ...]]
    """Names of the n columns of the state."""
    coordinates: ClassVar[tuple[str, ...] | None] = None
    """Names of the quantities in boxes of initial states, if these are not the state; see `initial_states`."""
    beyond_state: ClassVar[tuple[str, ...]] = ()
    """What `features` has beyond the state, in words for people: "bearing of the goal", "which goal counts"."""

    def __init__(self, dt: float) -> None:
        self.dt = dt

    @abstractmethod
    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: state (N, n), action (N, axes) -> state (N, n). May not change its arguments."""

    def initial_states(self, coordinates: Array) -> Array:
        """The states (N, n) at points (N, number of `coordinates`) of a box of initial states. The same by default."""
        return coordinates

    @abstractmethod
    def signals(self, state: Array) -> Array:
        """What the formula is read from: (..., n) -> (..., k), in the order of the task file's `signals`."""

    @abstractmethod
    def features(self, state: Array, t: Integers) -> Array:
        """What the policy sees of the state, scaled to about [-1, 1]: (N, n), t (N,) in 0..T -> (N, d).

        The harness appends the time t/T and the method's inputs. The features are the task's, so every method's
        policy sees the same. What they have beyond the state itself is said by `beyond_state`.
        """

    def scaled_state(self, state: Array) -> Array:
        """The state alone: (N, n) -> (N, d), each column about in [-1, 1], an angle as its cosine and sine.

        What the policy sees in place of `features` on the track `plain`, and without=features. The state as it is by
        default.
        """
        return state

    def controller(self, state: Array, t: Integers) -> Array | None:
        """A controller written by hand: (N, n), t (N,) -> actions (N, axes), or None where a task has none.

        It shows that the formula can be satisfied, and its robustness is what learned policies are compared with.
        It knows the whole state and the formula; no agent is shown what it does. It is asked every `hold` steps, and
        its actions are clipped, or on a grid rounded to the nearest value of each axis.
        """
        return None


# ----------------------------------------------------------------------------------------------------------- agents


class Transition(NamedTuple):
    """What `Environment.step` returns, for N copies. The policy knows the time, so its limit is no terminal state.

    =========================================  ========  =====  =======
    what happened                              discount  cut    ended
    =========================================  ========  =====  =======
    the episode goes on                        1         False  False
    a boundary was crossed (`training.cuts`)   1         True   False
    the time limit T, or broken off before it  1         True   True
    an end (`training.ends`): nothing follows  0         True   True
    =========================================  ========  =====  =======
    """

    observation: Array
    """(N, D): what to act on next."""
    reward: Array
    """(N,): the method's reward, averaged over the steps that the action was held, over the method's `scale`."""
    arrived: Array
    """(N, D): what the action led to, to bootstrap from; differs from `observation` only where `cut`."""
    discount: Array
    """(N,): 1 to bootstrap; 0 where nothing follows, and `reward` counts as if paid for ever, r / (1 - gamma)."""
    cut: Truth
    """(N,): a return of several rewards stops here, though the episode may go on."""
    ended: Truth
    """(N,): the episode is over, and `observation` is of the next one."""


class Environment(Protocol):
    """N copies of a task with a method's reward, in lock-step, restarting by themselves."""

    count: int
    """N."""
    observation_size: int
    """D: features, time t/T scaled to [-1, 1], and the method's inputs."""
    actions: Actions
    hold: int
    """Steps for which one action is held; the formula still sees every step."""

    def reset(self) -> Array:
        """Start N episodes: the first observation, (N, D)."""

    def step(self, action: Integers | Array) -> Transition:
        """Hold actions for `hold` steps: indices (N,) of a grid, or vectors (N, axes), clipped to the actions' ends."""


class Policy(ABC):
    """A trained policy, frozen: later training does not change it."""

    @abstractmethod
    def act(self, observation: Array) -> Integers | Array:
        """The greedy actions, without any randomness: (N, D) -> indices (N,), or vectors (N, axes)."""

    def arrays(self) -> Arrays | None:
        """All that `Agent.restore` makes the same policy of, a few megabytes at most. None where it cannot be kept.

        A policy without them, as by default, is scored like any other, and gone when its cell ends.
        """
        return None

    def onnx(self) -> bytes | None:
        """The policy as an ONNX model, for other programs; None, as by default, where it has no such form.

        Its input is `observation`, float32 (N, D). Its output is what `act` returns: `index`, int64 (N,), of a grid, or
        `action`, float64 (N, axes). Raises `Unsuitable` where a library is not installed.
        """
        return None


class StatePolicy(ABC):
    """A policy that acts on the whole state, such as a planner's. Frozen, like every policy.

    It sees more than a learned policy does, so tables say which agent it comes from.
    """

    @abstractmethod
    def episode(self) -> Callable[[Array, Integers, Array], Integers | Array]:
        """What acts in one batch of episodes, from their starts on.

        It is called at every decision with the states (N, n), their steps t (N,) and the method's memory (N, m), and
        returns actions: indices (N,) of a grid, or vectors (N, axes). It may remember what happened in its episodes.
        """

    def value(self, state: Array) -> Array:
        """What it expects of episodes from the states (N, n) at step 0: (N,), in the unit of what it maximises.

        Of a robustness, the referee's score is what was reached: the two bracket what is possible. NaN by default.
        """
        return np.full(len(state), np.nan)


class End(NamedTuple):
    """Where training episodes end early, as if `reward` were paid for ever after."""

    over: Callable[[Array], Truth]
    """Signals (..., k) to whether the episode ends there (...)."""
    active: Truth
    """(T + 1,): the samples at which it does."""
    reward: float
    """In units of the method's `scale`, in place of the method's own of that decision: its `floor`."""


@dataclass(frozen=True)
class Model:
    """The task and the reward as pure functions: what an agent is given that plans (`Agent.plans`), and no learner."""

    system: System
    method: RewardMethod
    """Its `specification` has the signals, their ranges, and the formula as it is rewarded."""
    formula: stl.Formula
    """What the referee scores, intervals in steps."""
    actions: Actions
    steps: int
    """T: transitions in an episode."""
    hold: int
    """Steps for which one action is held."""
    cuts: tuple[int, ...]
    """Steps at which a return stops in training, with the value of going on as before."""
    ends: tuple[End, ...]
    """Where a training episode ends early. Of two at the same decision, the first counts."""
    starts: Array
    """(several, n): states from which training episodes start."""


@dataclass(frozen=True)
class Training:
    """All that an agent is given for one cell."""

    make: Callable[[int], Environment]
    """Make the environment with N copies; its initial states depend on the cell's seed and on nothing of the method."""
    steps: int
    """Budget: environment steps of one sampling time, summed over the copies."""
    seed: int
    """For the agent's own randomness; the same for every method of a task."""
    report: Callable[[Policy | StatePolicy, int], None]
    """Call it as report(policy, steps so far) at about `checkpoints` evenly spaced times and at the end. The referee
    scores the policy on starts kept for selection; the time it takes is not counted as training."""
    checkpoints: int = 20
    model: Model | None = None
    """For an agent that plans; None for one that learns."""


class Cost(NamedTuple):
    """What training takes, by counting."""

    replay: int
    """Bytes of the transitions that are kept at the same time."""
    update: float
    """Work of an update, in any unit: of two sizes of observations, the ratio is about that of their times."""


class Agent(ABC):
    """A training algorithm. Its keyword-only parameters are the recipe, which the task file gives; else the defaults.

    A task's recipe is the same for every method: an agent that learns is never told which method it trains. The
    constructor raises `Unsuitable` where it cannot train here at all, as without a library; `train`, where a task's
    actions do not fit.
    """

    plans: ClassVar[Literal["reward", "formula"] | None] = None
    """What it makes the most of where it plans: the method's reward, or the formula's robustness, whatever the method.
    It is then given dynamics and reward themselves, as `Training.model`, in place of environments to learn from. What
    it finds shows what a reward asks for, or what is possible; it is no rival of learned policies."""
    search_space: ClassVar[Mapping[str, tuple[float | int | str | bool, ...]]] = MappingProxyType({})
    """What `stlbench tune` tries, the same for every method: parameter -> values. `hold` stands for the steps for which
    the task holds an action; of its values those count that fit the task. The value of the task's own recipe is tried
    as well. A method that is first paid late needs a discount near 1, and one that is paid at once a smaller one: leave
    such parameters out, and the comparison is one of methods with the recipe of one of them."""

    @abstractmethod
    def train(self, training: Training) -> Policy | StatePolicy:
        """Spend the budget and return the final policy. The same `training.seed` gives the same policy, bit for bit."""

    @classmethod
    def restore(cls, arrays: Arrays, actions: Actions) -> Policy:
        """The policy that gave these `Policy.arrays`, for a task with these actions. It acts the same, bit for bit.

        A method of the class: a policy can be used where, for want of a library, the agent cannot train. Raises
        `Unsuitable` for arrays that are of none of its policies or of other actions, by default for all.
        """
        raise Unsuitable("it does not say how its policies are restored")

    def cost(self, size: int, actions: Actions, decisions: int) -> Cost | None:
        """What training would take; None, as by default, where the agent cannot say, and is then never refused.

        Args:
            size: D, numbers in an observation.
            actions: of the task.
            decisions: of all copies together, in the whole budget.
        """
        return None

    def uncompiled(self) -> Callable[[], None] | None:
        """What compiles the agent's code, where it is compiled and this machine has not done so yet; None elsewhere.

        The harness calls it before the first cell, and says that it does. Without it, what is compiled at first use
        takes its time in every cell, unless it is kept on disk.
        """
        return None

    def preload(self) -> None:  # noqa: B027 - most have nothing to load
        """Import the libraries that training needs, and load compiled code, for many cells at once.

        It is called in the process from which those of cells are forked, so it starts no threads and changes nothing
        that another agent could see. Of other distributions than stlbench's it is not called: what their import changes
        stays in their own cells.
        """
