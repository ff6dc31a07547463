"""Tasks: a `System` of pure functions, or a `World` that steps by itself; and suites, which make tasks from their
names. Import them from `stlbench.contract`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from stlbench.contract.arrays import Array, Integers, Truth

if TYPE_CHECKING:
    import gymnasium


class System(ABC):
    """The dynamics of a task, N copies at once. Pure: NumPy in, NumPy out, no random numbers, no hidden state.

    The `task.yaml` beside its module says the rest: formula, signals and their ranges, actions, sampling time, initial
    states, recipes, budgets. `parameters` of that file arrive as keyword arguments.
    """

    state: ClassVar[tuple[str, ...]]
    """Names of the n columns of the state."""

    def __init__(self, dt: float) -> None:
        self.dt = dt

    @abstractmethod
    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: state (N, n), action (N, axes) -> state (N, n). May not change its arguments."""

    @abstractmethod
    def signals(self, state: Array) -> Array:
        """The signals of the formula: (..., n) -> (..., k), in the order of the task file's `signals`."""

    # ------------------------------------------------------------------ additions

    coordinates: ClassVar[tuple[str, ...] | None] = None
    """Names of the quantities in boxes of initial states, if they are not the state (`initial_states`)."""
    beyond_state: ClassVar[tuple[str, ...]] = ()
    """The entries of `features` beyond the state, for people: "bearing of the goal", "which goal counts"."""

    def initial_states(self, coordinates: Array) -> Array:
        """The states (N, n) at points (N, number of `coordinates`) of a box of initial states. The same by default."""
        return coordinates

    def features(self, state: Array, t: Integers) -> Array:
        """The policy's view of the state, scaled to about [-1, 1]: (N, n), t (N,) in 0..T -> (N, d).

        The harness appends the time t/T and the method's inputs. The scaled state by default.
        """
        return self.scaled_state(state)

    def scaled_state(self, state: Array) -> Array:
        """The state alone: (N, n) -> (N, d), each column about in [-1, 1], an angle as its cosine and sine.

        The policy sees it in place of `features` on the track `plain`. The state as it is by default.
        """
        return state

    def controller(self, state: Array, t: Integers) -> Array | None:
        """A controller written by hand: (N, n), t (N,) -> actions (N, axes); None if a task has none.

        It shows that the formula can be satisfied, and learned policies are compared with its robustness. It may use
        the whole state and the formula. It acts every `hold` steps. Its actions, finite numbers, are clipped, or
        rounded to the grid along each axis.
        """
        return None


class GymTask:
    """A task on an environment of Gymnasium, if a `task.yaml` with `environment` cannot say all of it.

    Most such tasks need no class. Write one for an environment that is not registered, or for a controller. A signal
    also needs one if it is no expression over entries of the observation and the info. `parameters` of the task file
    arrive as keyword arguments.

    The environment may be random, and its state may be hidden. The same `reset(seed=...)` and the same actions have to
    give the same episode.
    """

    render_mode: Literal["rgb_array"] | None = None
    """`make` passes it on to its environment: "rgb_array" for copies that are drawn, else None. A class that does not
    pass it on has no pictures."""

    def make(self) -> gymnasium.Env[Any, Any] | None:
        """One environment without a time limit; None, the default, for the task file's `environment`."""
        return None

    def signals(self, observation: Any, info: Mapping[str, Any]) -> Sequence[float] | None:
        """The k signals of one sample, in the order of the task file; None, the default, for its expressions."""
        return None

    def controller(self, observation: Any, info: Mapping[str, Any], t: int) -> Sequence[float] | None:
        """The action (axes,) of a controller written by hand at step t of one copy; None if a task has none.

        Actions are within their range. A `Discrete` space takes the nearest whole number.
        """
        return None


class WorldTask(ABC):
    """A task on a simulation that steps many copies at once by itself: in C++, on a graphics card, or vectorised.

    Its `task.yaml` has no `initial`, as starts are seeds. `parameters` of that file arrive as keyword arguments.
    """

    @abstractmethod
    def world(self, count: int) -> World:
        """A world of so many copies, not yet started."""


class World(ABC):
    """N copies of a controlled system in lock-step, each in its own episode.

    The harness makes one of a `System` or of environments of Gymnasium; a `WorldTask` brings its own. Agents, methods
    and the referee see no difference.

    A copy begins at its start: a state for a system, else a seed, which is a whole number. The same seed and the same
    actions give the same episode, whatever the copy did before.
    """

    can_end: ClassVar[bool] = True
    """Whether a copy can end by itself. If it cannot, `ended` is not read."""
    signals: Array
    """(N, k): the newest sample of each copy, in the order of the task file's `signals`."""
    ended: Truth
    """(N,): the copies that have ended by themselves. Their last sample stays."""
    lived: Integers
    """(N,): the steps that each copy has made since its start, until it ended."""

    @abstractmethod
    def restart(self, rows: Integers, starts: Array) -> None:
        """Begin new episodes in the rows (r,), at the starts (r, s); s is 1 for seeds. All rows begin before a step."""

    @abstractmethod
    def advance(self, action: Array, steps: int) -> Array:
        """Hold the actions (N, axes) for so many steps.

        Returns:
            The samples before and after each step, (steps + 1, N, k). The last of them is now `signals`.
        """

    @abstractmethod
    def features(self, t: Integers) -> Array:
        """The policy's view of each copy at steps t (N,), about in [-1, 1]: (N, d)."""

    # ------------------------------------------------------------------ additions

    @property
    def state(self) -> Array:
        """The states (N, n) of the copies; (N, 0) if they cannot be read."""
        return np.empty((len(self.signals), 0))

    def frames(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A picture of each copy, (height, width, 3), always of one size; None if the world has none.

        Raises `RuntimeError`, in one line, if this machine cannot draw.
        """
        return None

    def by_hand(self, t: Integers) -> Array | None:
        """The actions (N, axes) of a controller written by hand at steps t (N,); None if there is none.

        They are within their range. A grid takes the nearest value of each axis.
        """
        return None


class SuiteTask(NamedTuple):
    """One task of a suite, in place of a package with a task."""

    system: type[System]
    file: str
    """The text of its `task.yaml`."""


class SuiteScores(NamedTuple):
    """The results of methods on one task of a suite."""

    formula: str
    """Its intervals are in steps."""
    scores: Mapping[str, Sequence[float]]
    """Method -> for each seed the robustness, 0 at random and 1 the best known; only of methods that fit."""


class Suite(ABC):
    """Tasks that are made from their names, such as `unicycle/sequence/3`.

    The same name gives the same task for ever; tasks that differ belong to a suite of another name. A user writes
    `suite:unicycle/sequence/3`, with the suite's own name before the colon. In results the task has the name
    `suite-unicycle-sequence-3`.
    """

    @property
    @abstractmethod
    def names(self) -> Sequence[str]:
        """The names of all tasks: parts of a-z, 0-9 and -, with slashes between them."""

    @property
    @abstractmethod
    def splits(self) -> Mapping[str, Sequence[str]]:
        """Names of sets of tasks, such as `dev`, and the names of their tasks."""

    @abstractmethod
    def task(self, name: str) -> SuiteTask:
        """The task of one of the `names`."""

    # ------------------------------------------------------------------ additions

    def groups(self, name: str) -> Mapping[str, str]:
        """The groups of a task, such as its system and its template: kind of group -> the task's group.

        All tasks have the same kinds. Reports say for each group how methods do on its tasks. Tasks with a group count
        as a sample: intervals are for all tasks that the suite could draw.
        """
        return {}

    def witness(self, name: str) -> Integers | None:
        """Actions from each of the report's starts that show what is possible; None if nothing is known.

        Indices of the grid of actions, (starts, decisions).
        """
        return None

    def scores(self) -> Sequence[SuiteScores]:
        """The results of methods on its tasks. `stlbench advise` judges by them which method suits a formula."""
        return ()
