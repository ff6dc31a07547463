"""The dynamics of a task, as pure functions. Import them from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from stlbench.contract.arrays import Array, Integers


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
        its actions, finite numbers, are clipped, or on a grid rounded to the nearest value of each axis.
        """
        return None
