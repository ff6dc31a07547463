"""The templates: forms of formulas. A scene is a room with regions and obstacles that are drawn from a name. A template
takes regions from it and gives a formula, with intervals in steps.

The docstring of a template ends the `source` of its tasks, so users read it.
"""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate, pairwise, permutations
from math import ceil
from typing import Literal

import numpy as np

from stlbench_tasks.suite.systems import About, Arm, Place, SuiteSystem

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


def reach(scene: Scene) -> str:
    """Be in a region once: F[0,b] A, for each point."""
    return _reach(scene, "", 0)


def reach_stay(scene: Scene) -> str:
    """Reach a region and stay: F[0,b] G[0,s] A, for each point."""
    stay = 2 * scene.stay()
    return _reach(scene, f"G[0,{stay}] ", stay)


def _reach(scene: Scene, held: str, stay: int) -> str:
    goals = [scene.region(point) for point in range(len(scene.about.points))]
    end = max(_legs(scene, goals))
    return _with_clutter(scene, [f"F[0,{end}] {held}{goal}" for goal in goals], end + stay, 0)


def avoid_reach(scene: Scene) -> str:
    """Reach a region around obstacles: F[0,b] A & G[0,b] !O, for each point."""
    goals = [scene.region(point) for point in range(len(scene.about.points))]
    end = max(_legs(scene, goals)) + scene.steps(1.5 * scene.slack)
    for start, goal in zip(scene.starts, goals, strict=True):
        scene.block(start, goal.centre)
    return _with_clutter(scene, [f"F[0,{end}] {goal}" for goal in goals], end, 4)


def sequence(scene: Scene) -> str:
    """Regions in turn, each within its own window: F[0,b] A & F[b,c] B & ..."""
    goals = _regions(scene, 2, 4)
    ends = list(accumulate(_legs(scene, goals)))
    terms = [f"F[{begin},{end}] {goal}" for (begin, end), goal in zip(pairwise([0, *ends]), goals, strict=True)]
    return _with_clutter(scene, terms, ends[-1], 2)


def chain(scene: Scene) -> str:
    """Regions in turn, each within a time after the one before: F[0,a] (A & F[0,b] (B & ...))."""
    goals = _regions(scene, 2, 3)
    legs = _legs(scene, goals)
    formula = f"F[0,{legs[-1]}] {goals[-1]}"
    for leg, goal in zip(legs[-2::-1], goals[-2::-1], strict=True):
        formula = f"F[0,{leg}] ({goal} & {formula})"
    return _with_clutter(scene, [formula], sum(legs), 2)


def free_order(scene: Scene) -> str:
    """All regions, in any order: F[0,b] A & F[0,b] B & ..."""
    goals = _regions(scene, 2, 4)
    scene.tours = sorted(map(list, permutations(goals)), key=lambda tour: sum(_legs(scene, tour)))
    end = sum(_legs(scene, scene.tours[0]))
    return _with_clutter(scene, [f"F[0,{end}] {goal}" for goal in goals], end, 2)


def either_or(scene: Scene) -> str:
    """Stay in one of two regions: F[0,b] (G[0,s] A | G[0,s] B)."""
    one, other = scene.region(), scene.region()
    scene.tours = [[one], [other]]
    stay = 2 * scene.stay()
    end = max(scene.leg(scene.starts[0], one.centre), scene.leg(scene.starts[0], other.centre))
    return _with_clutter(scene, [f"F[0,{end}] (G[0,{stay}] {one} | G[0,{stay}] {other})"], end + stay, 4)


def until(scene: Scene) -> str:
    """Keep out of one region until another is reached, then reach it: (!A U[0,b] B) & F[b,c] A."""
    door, key = scene.region(), scene.region()
    scene.tours = [[key, door]]
    first, second = _legs(scene, [key, door])
    first += scene.steps(scene.slack)
    return _with_clutter(
        scene, [f"{door.outside} U[0,{first}] {key}", f"F[{first},{first + second}] {door}"], first + second, 2
    )


def patrol(scene: Scene) -> str:
    """Visit two regions again and again: G[0,b] (F[0,w] A & F[0,w] B)."""
    return _patrol(scene, 0)


def patrol_stay(scene: Scene) -> str:
    """Stay in two regions again and again: G[0,b] (F[0,w] G[0,s] A & F[0,w] G[0,s] B)."""
    return _patrol(scene, scene.about.hold)


def _patrol(scene: Scene, stay: int) -> str:
    one, other = scene.region(spread=1.0), scene.region(spread=1.0)
    there = scene.leg(one.centre, other.centre)
    first = min(scene.leg(scene.starts[0], goal.centre) for goal in (one, other))
    window = max(first + there, 2 * there) + 2 * stay
    held = f"G[0,{stay}] " if stay else ""
    rounds = scene.draw.whole(1, 2) * window
    scene.tours = [[one, other] * 4, [other, one] * 4]
    visits = f"F[0,{window}] {held}{one} & F[0,{window}] {held}{other}"
    return _with_clutter(scene, [f"G[0,{rounds}] ({visits})"], rounds + window + stay, 0)


def response(scene: Scene) -> str:
    """Go to a region, and whenever there, to another soon: F[0,b] A & G[0,c] (A -> F[0,w] B)."""
    call, answer = scene.region(), scene.region()
    first, window = _legs(scene, [call, answer])
    end = first + scene.draw.whole(1, 4) * scene.about.hold
    return _with_clutter(
        scene, [f"F[0,{first}] {call}", f"G[0,{end}] ({call} -> F[0,{window}] {answer})"], end + window, 2
    )


def tube(scene: Scene) -> str:
    """Stay in a disc that moves in steps: G[a,b] A & G[b,c] B & ..., with regions that overlap."""
    disc = scene.region()
    ends, terms = [scene.leg(scene.starts[0], disc.centre)], list[str]()
    dx, dy = scene.draw.whole(-1, 1), scene.draw.whole(-1, 1)
    for _ in range(scene.draw.whole(2, 4)):
        moved = _moved(disc, (dx or 1 - abs(dy)) * 0.7 * disc.radius, dy * 0.7 * disc.radius)
        ends.append(ends[-1] + scene.steps(scene.slack * (disc.radius / scene.about.pace + 0.5)))
        terms.append(f"G[{ends[-2]},{ends[-1]}] {disc}")
        scene.regions.append(moved)
        disc = moved
    end = ends[-1] + scene.about.hold
    return _with_clutter(scene, [*terms, f"G[{ends[-1]},{end}] {disc}"], end, 0)


def overlap(scene: Scene) -> str:
    """Stay in regions within windows that overlap: F[a,c] G[0,s] A & F[b,d] G[0,s] B & ..., with a < b < c < d."""
    goals = _regions(scene, 2, 3)
    stay, held, terms = scene.stay(), scene.about.hold, list[str]()
    ends = list(accumulate(leg + stay for leg in _legs(scene, goals)))
    for before, end, goal in zip([0, *ends], ends, goals, strict=False):
        begin = before // 2 // held * held
        terms.append(f"F[{begin},{end}] G[0,{stay}] {goal}")
    return _with_clutter(scene, terms, ends[-1] + stay, 2)


def deliver(scene: Scene) -> str:
    """One robot fetches, both meet side by side, the other brings: F[0,a] A & F[a,b] (H & K) & F[b,c] B."""
    fetch, here = scene.region(0), scene.region(0, 2.0)
    there = Disc(scene.about.points[1], (round(here.centre[0] + 0.6, 4), here.centre[1]), here.radius)
    scene.regions.append(there)
    bring = scene.region(1)
    first = scene.leg(scene.starts[0], fetch.centre)
    met = first + max(scene.leg(fetch.centre, here.centre), scene.leg(scene.starts[1], there.centre))
    end = met + scene.leg(there.centre, bring.centre)
    terms = [f"F[0,{first}] {fetch}", f"F[{first},{met}] ({here} & {there})", f"F[{met},{end}] {bring}"]
    return _with_clutter(scene, terms, end, 1)


def _regions(scene: Scene, least: int, most: int) -> list[Disc]:
    """New regions, of all points in turn."""
    count = scene.draw.whole(least, most if scene.level == "hard" else most - (most > least))
    return [scene.region(number % len(scene.about.points)) for number in range(count)]


def _legs(scene: Scene, goals: Sequence[Disc]) -> list[int]:
    """Steps for each leg of a tour. A point waits where it was last."""
    places = dict[tuple[str, ...], Place](zip(scene.about.points, scene.starts, strict=True))
    legs = []
    for goal in goals:
        legs.append(scene.leg(places[goal.names], goal.centre))
        places[goal.names] = goal.centre
    return legs


def _moved(disc: Disc, dx: float, dy: float) -> Disc:
    """The disc at another place, within the room."""
    x, y = (min(max(at + by, disc.radius), 6 - disc.radius) for at, by in zip(disc.centre, (dx, dy), strict=True))
    return Disc(disc.names, (round(x, 2), round(y, 2)), disc.radius)


def _with_clutter(scene: Scene, terms: list[str], end: int, most: int) -> str:
    """The conjunction of terms that end at step `end`, with an invariant where there is one."""
    invariant = scene.clutter(most)
    return " & ".join([f"({term})" for term in terms] + ([f"G[0,{end}] ({invariant})"] if invariant else []))


TEMPLATES: Mapping[str, Callable[[Scene], str]] = {
    each.__name__.replace("_", "-"): each
    for each in (
        *(reach, reach_stay, avoid_reach, sequence, chain, free_order, either_or),
        *(until, patrol, patrol_stay, response, tube, overlap, deliver),
    )
}
"""Templates by the name that tasks have."""
