"""A description of a system of the suite."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from stlbench.contract import Array, System

Place = tuple[float, float]
ROOM = (0.0, 6.0, "m")
"""The range of a coordinate."""


@dataclass(frozen=True, kw_only=True)
class About:
    """The sizes by which formulas are drawn. Points move in a room of 6 m, a square or a line."""

    ranges: Mapping[str, tuple[float, float, str]]
    """Signal -> the ends of its range and its unit."""
    axes: Mapping[str, tuple[float, float, int, str]]
    """Action -> its ends, the count of its values and its unit."""
    pace: float
    """Metres a second at which a point gets on, from which deadlines are made."""
    settle: float
    """Seconds that a way takes beyond that, to turn or to brake."""
    top: float
    """The greatest speed of a point at the start and without `push`, in metres a second; for upper bounds."""
    push: float = 0.0
    """The greatest acceleration of a point."""
    hold: int = 5
    """Steps for which an action is held."""
    decisions: int = 160_000
    """In a training with the budget `quick`: about 10 CPU seconds."""
    points: tuple[tuple[str, ...], ...] = (("x", "y"),)
    """The signals of each point that regions are about."""
    spread: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """State -> the ends of its starts, where it is no coordinate of a point; 0 where left out."""
    robots: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    always: str = ""
    """The formula that has to hold all the time, beside the drawn one."""

    def farthest(self, seconds: Array) -> Array:
        """Metres that a point can be away from its start after so many seconds, at most."""
        return self.top * seconds + self.push * seconds**2 / 2


class SuiteSystem(System):
    """A system on which formulas are drawn."""

    about: ClassVar[About]

    def signals(self, state: Array) -> Array:
        """The columns of the state that have the names of signals: (..., n) -> (..., k)."""
        return state[..., [self.state.index(name) for name in self.about.ranges]]

    @classmethod
    def begin(cls, places: tuple[Place, ...]) -> dict[str, tuple[float, float]]:
        """The box of initial states: the points up to 0.4 m from these places along each axis."""
        about = cls.about
        pairs = [
            pair for names, place in zip(about.points, places, strict=True) for pair in zip(names, place, strict=False)
        ]
        around = {name: (round(at - 0.4, 4), round(at + 0.4, 4)) for name, at in pairs}
        return {name: around.get(name) or about.spread.get(name, (0.0, 0.0)) for name in cls.state}


def scaled(values: Array) -> Array:
    """Metres in the room from -1 to 1."""
    scaled: Array = (values - 3) / 3
    return scaled
