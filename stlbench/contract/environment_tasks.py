"""Tasks that are no `System`: environments, and worlds of one's own. Import them from `stlbench.contract`."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from stlbench.contract.world import World

if TYPE_CHECKING:
    import gymnasium


class GymTask:
    """A task on an environment of Gymnasium: what of it a `task.yaml` with `environment` cannot say.

    Most such tasks need no class. Write one where the environment is not registered, where a signal is no expression
    over entries of the observation and of the info, or to have a controller by hand. `parameters` of the task file
    arrive as keyword arguments.

    The environment may be random, and may have a state that nobody can set. It has to give the same episode for the
    same `reset(seed=...)` and the same actions.
    """

    render_mode: Literal["rgb_array"] | None = None
    """What `make` passes on to its environment: "rgb_array" of copies that films and `render` show, else None. A class
    that does not pass it on has no pictures."""

    def make(self) -> gymnasium.Env[Any, Any] | None:
        """One environment, without a time limit; None, as by default, for that of the task file's `environment`."""
        return None

    def signals(self, observation: Any, info: Mapping[str, Any]) -> Sequence[float] | None:
        """The k signals of one sample, in the order of the task file; None, as by default, for its expressions."""
        return None

    def controller(self, observation: Any, info: Mapping[str, Any], t: int) -> Sequence[float] | None:
        """A controller written by hand: what it does at step t in one copy, (axes,); None where a task has none.

        Its actions are within their range; of whole numbers, as a `Discrete` space has, the nearest is taken.
        """
        return None


class WorldTask(ABC):
    """A task on a simulation that steps many copies at once by itself: in C++, on a graphics card, or vectorised.

    Its `task.yaml` has no `initial`, as starts are seeds. `parameters` of that file arrive as keyword arguments.
    """

    @abstractmethod
    def world(self, count: int) -> World:
        """That many copies, none of them begun."""
