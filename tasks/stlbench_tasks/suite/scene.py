"""A scene: a room with regions and obstacles, drawn from a name."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from math import ceil
from typing import Literal

import numpy as np

from stlbench_tasks.suite.about import About, Place, SuiteSystem
from stlbench_tasks.suite.systems import Arm

Level = Literal["usual", "hard"]


MIDDLE = (3.0, 3.0)
DT = 0.1
"""The sampling time of all tasks in seconds."""


class Cramped(Exception):
    """The room has no place left: this candidate is no task."""


class Draw:
    """Random numbers that a name determines on every machine and with every version of NumPy."""

    def __init__(self, name: str) -> None:
        seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:16], "big")
        self._bits = np.random.PCG64(seed)

    def whole(self, low: int, high: int) -> int:
        """A whole number from low to high, both included."""
        return low + int(self._bits.random_raw()) % (high - low + 1)

    def number(self, low: float, high: float, step: float = 0.05) -> float:
        """A multiple of `step` above low, up to high, without digits beyond the fourth."""
        return round(low + step * self.whole(0, round((high - low) / step)), 4)


@dataclass(frozen=True)
class Disc:
    """A disc for one of the system's points; as text, the predicate that the point is inside."""

    names: tuple[str, ...]
    """The point's signals."""
    centre: Place
    """Its second number means nothing on a line."""
    radius: float

    @property
    def outside(self) -> str:
        """The predicate that the point is not inside."""
        return f"{self._distance} >= {self.radius:g}"

    def __str__(self) -> str:
        return f"{self._distance} <= {self.radius:g}"

    @property
    def _distance(self) -> str:
        offsets = [f"{name} - {at:g}" for name, at in zip(self.names, self.centre, strict=False)]
        return f"{'norm' if len(offsets) > 1 else 'abs'}({', '.join(offsets)})"


def apart(one: Place, other: Place, distance: float) -> bool:
    """Whether two places are farther apart than that."""
    return (one[0] - other[0]) ** 2 + (one[1] - other[1]) ** 2 > distance**2


@dataclass
class Scene:
    """The scene that a template draws from: places that do not touch, and deadlines that a robot can meet."""

    system: type[SuiteSystem]
    draw: Draw
    level: Level
    starts: list[Place] = field(default_factory=list)
    """The middle of each point's starts."""
    regions: list[Disc] = field(default_factory=list)
    obstacles: list[Disc] = field(default_factory=list)
    tours: list[list[Disc]] = field(default_factory=list)
    """Orders in which regions can be visited; for the search for a witness. All regions in turn where it is empty."""
    slack: float = 0.0
    """How much longer than the way takes at the system's pace a leg may take."""

    @property
    def about(self) -> About:
        """The system's description."""
        return self.system.about

    def __post_init__(self) -> None:
        self.slack = self.draw.number(1.3, 1.8) if self.level == "usual" else self.draw.number(1.0, 1.25)
        for _ in self.about.points:
            self.starts.append(self._place(0.6, 1.8))

    def region(self, point: int = 0, spread: float = 1.5) -> Disc:
        """A new region for a point, with `spread` metres between it and other regions."""
        least, most = (0.5, 0.8) if self.level == "usual" else (0.4, 0.55)
        radius = self.draw.number(least, most)
        self.regions.append(Disc(self.about.points[point], self._place(radius, spread), radius))
        return self.regions[-1]

    def block(self, start: Place, goal: Place) -> None:
        """A new obstacle on the way from one place to another."""
        radius = self.draw.number(0.4, 0.7)
        centre = (round((start[0] + goal[0]) / 2, 2), round((start[1] + goal[1]) / 2, 2))
        self.obstacles.append(Disc(self.about.points[0], centre, radius))

    def clutter(self, most: int) -> str:
        """The invariant that all points avoid new obstacles, so many as are drawn; and what always has to hold."""
        more = self.draw.whole(0, most) + (self.level == "hard" and most > 0)
        for _ in range(more if len(self.about.points[0]) > 1 else 0):
            radius = self.draw.number(0.4, 0.8)
            self.obstacles.append(Disc(self.about.points[0], self._place(radius, 0.6), radius))
        outside = [
            Disc(names, each.centre, each.radius).outside for each in self.obstacles for names in self.about.points
        ]
        return " & ".join([*outside, *([self.about.always] if self.about.always else [])])

    def leg(self, start: Place, goal: Place) -> int:
        """Steps for the way from one place to another: whole decisions, with slack."""
        length = ((start[0] - goal[0]) ** 2 + (start[1] - goal[1]) ** 2) ** 0.5
        return self.steps(self.slack * (length / self.about.pace + self.about.settle))

    def steps(self, seconds: float) -> int:
        """Steps of so many seconds, rounded up to whole decisions."""
        held = self.about.hold
        return max(1, ceil(round(seconds / (DT * held), 6))) * held

    def stay(self) -> int:
        """Steps for which a point stays in a region."""
        return self.draw.whole(1, 4) * self.about.hold

    def _place(self, radius: float, spread: float) -> Place:
        """A place for a disc, apart from what is there already."""
        on_line = len(self.about.points[0]) == 1
        spread = 0.3 if on_line else spread
        for _ in range(200):
            x, y = (self.draw.number(radius + 0.1, 5.9 - radius) for _ in range(2))
            place = (x, MIDDLE[1]) if on_line else (x, y)
            far = all(apart(place, disc.centre, disc.radius + radius + spread) for disc in self.regions)
            clear = all(apart(place, disc.centre, disc.radius + radius + 0.5) for disc in self.obstacles)
            free = all(apart(place, start, radius + 0.6 + spread / 2) for start in self.starts)
            if far and clear and free and self._in_reach(place):
                return place
        raise Cramped

    def _in_reach(self, place: Place) -> bool:
        """Whether the arm reaches it, where the system is one."""
        return self.system is not Arm or (apart(place, MIDDLE, 0.6) and not apart(place, MIDDLE, 2.9))
