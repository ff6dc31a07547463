"""The systems of the suite: their motion, and the entries that a `task.yaml` would have for each."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import pi
from typing import ClassVar

import numpy as np

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
    """The decisions in a training with the budget `quick`, about 10 CPU seconds."""
    points: tuple[tuple[str, ...], ...] = (("x", "y"),)
    """The signals of each point that regions are about."""
    spread: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """State -> the ends of its starts, if it is no coordinate of a point; 0 if left out."""
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


_GRAVITY = 9.81


class Integrator(SuiteSystem):
    """A point whose velocity is controlled: p' = p + dt v."""

    state: ClassVar[tuple[str, ...]] = ("x", "y")
    about = About(
        ranges={"x": ROOM, "y": ROOM},
        axes={"vx": (-1.0, 1.0, 5, "m/s"), "vy": (-1.0, 1.0, 5, "m/s")},
        pace=0.9,
        settle=0.5,
        top=2**0.5,
    )

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, n), (N, n) -> (N, n)."""
        return state + self.dt * action

    def scaled_state(self, state: Array) -> Array:
        """The place: (N, n) -> (N, n)."""
        return scaled(state)


class DoubleIntegrator(SuiteSystem):
    """A point whose acceleration is controlled: p' = p + dt v + dt^2 u / 2, v' = v + dt u. It starts at rest."""

    state = ("x", "y", "vx", "vy")
    about = About(
        ranges={"x": ROOM, "y": ROOM, "vx": (-2.0, 2.0, "m/s"), "vy": (-2.0, 2.0, "m/s")},
        axes={"ux": (-1.0, 1.0, 5, "m/s^2"), "uy": (-1.0, 1.0, 5, "m/s^2")},
        pace=0.7,
        settle=1.5,
        top=0.0,
        push=2**0.5,
    )

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 4), (N, 2) -> (N, 4)."""
        place, velocity = state[:, :2], state[:, 2:]
        moved = place + self.dt * velocity + self.dt**2 / 2 * action
        return np.concatenate([moved, velocity + self.dt * action], axis=1)

    def scaled_state(self, state: Array) -> Array:
        """The place, and the velocity over 2 m/s: (N, 4) -> (N, 4)."""
        return np.concatenate([scaled(state[:, :2]), state[:, 2:] / 2], axis=1)


class Unicycle(SuiteSystem):
    """A robot that drives and turns: its place moves by dt v along its heading, which turns by dt omega."""

    state = ("x", "y", "heading")
    about = About(
        ranges={"x": ROOM, "y": ROOM},
        axes={"v": (-1.0, 1.0, 5, "m/s"), "omega": (-1.5, 1.5, 7, "rad/s")},
        spread={"heading": (-pi, pi)},
        pace=0.8,
        settle=1.5,
        top=1.0,
    )

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 3), (N, 2) -> (N, 3)."""
        heading, ahead = state[:, 2], self.dt * action[:, 0]
        change = np.stack([ahead * np.cos(heading), ahead * np.sin(heading), self.dt * action[:, 1]], axis=1)
        return state + change

    def scaled_state(self, state: Array) -> Array:
        """The place, the heading's cosine and sine: (N, 3) -> (N, 4)."""
        heading = state[:, 2:]
        return np.concatenate([scaled(state[:, :2]), np.cos(heading), np.sin(heading)], axis=1)


class Quadrotor(SuiteSystem):
    """A quadrotor in a vertical plane. Controlled are the thrust a over its mass, and a turning u, with drag.

    v' = v + dt (-a sin(tilt), a cos(tilt) - g), rate' = rate + dt (u - 2 rate); then place and tilt move by these.
    """

    state = ("x", "z", "vx", "vz", "tilt", "rate")
    about = About(
        ranges={"x": ROOM, "z": ROOM, "tilt": (-1.5, 1.5, "rad")},
        axes={"thrust": (_GRAVITY - 4, _GRAVITY + 4, 5, "m/s^2"), "turn": (-4.0, 4.0, 5, "rad/s^2")},
        points=(("x", "z"),),
        always="abs(tilt) <= 1",
        hold=2,
        decisions=240_000,
        pace=0.6,
        settle=2.0,
        top=0.1 * (2 * _GRAVITY + 4),
        push=2 * _GRAVITY + 4,
    )

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 6), (N, 2) -> (N, 6)."""
        x, z, vx, vz, tilt, rate = state.T
        thrust, turn = action.T
        vx = vx - self.dt * thrust * np.sin(tilt)
        vz = vz + self.dt * (thrust * np.cos(tilt) - _GRAVITY)
        rate = rate + self.dt * (turn - 2 * rate)
        return np.stack([x + self.dt * vx, z + self.dt * vz, vx, vz, tilt + self.dt * rate, rate], axis=1)

    def scaled_state(self, state: Array) -> Array:
        """The place, velocities over 2 m/s, tilt and rate over 1: (N, 6) -> (N, 6)."""
        return np.concatenate([scaled(state[:, :2]), state[:, 2:4] / 2, state[:, 4:]], axis=1)


class CartPendulum(SuiteSystem):
    """A pole of 2 m that stands on a cart, whose acceleration u is controlled.

    v' = v + dt u, rate' = rate + dt (g sin(angle) - u cos(angle)) / 2; then place and angle move by these.
    """

    state = ("x", "v", "angle", "rate")
    about = About(
        ranges={"x": ROOM, "angle": (-1.0, 1.0, "rad")},
        axes={"u": (-4.0, 4.0, 9, "m/s^2")},
        points=(("x",),),
        spread={"angle": (-0.05, 0.05)},
        always="abs(angle) <= 0.5",
        hold=1,
        decisions=240_000,
        pace=0.6,
        settle=2.0,
        top=0.4,
        push=4.0,
    )

    def step(self, state: Array, action: Array) -> Array:
        """One sampling time later: (N, 4), (N, 1) -> (N, 4)."""
        x, v, angle, rate = state.T
        u = action[:, 0]
        v = v + self.dt * u
        rate = rate + self.dt * (_GRAVITY * np.sin(angle) - u * np.cos(angle)) / 2
        return np.stack([x + self.dt * v, v, angle + self.dt * rate, rate], axis=1)

    def scaled_state(self, state: Array) -> Array:
        """The place, the velocity over 2 m/s, the angle over 0.5 rad, its rate over 1 rad/s: (N, 4) -> (N, 4)."""
        return np.stack([scaled(state[:, 0]), state[:, 1] / 2, 2 * state[:, 2], state[:, 3]], axis=1)


class Arm(Integrator):
    """Three links of 1.4, 1.1 and 0.8 m from the middle of the room, whose joints' velocities are controlled.

    The signals are the place of the tip. Each joint's angle counts from the link before.
    """

    state = ("q1", "q2", "q3")
    links = np.array([1.4, 1.1, 0.8])
    about = About(
        ranges={"x": ROOM, "y": ROOM},
        axes={name: (-1.0, 1.0, 5, "rad/s") for name in ("w1", "w2", "w3")},
        pace=0.9,
        settle=1.0,
        top=6.0,
    )

    @classmethod
    def begin(cls, places: tuple[Place, ...]) -> dict[str, tuple[float, float]]:
        """The box of joint angles whose middle has the tip near the place, with the second and third joint alike."""
        dx, dy = places[0][0] - 3, places[0][1] - 3
        bends = np.linspace(0.0, 2.2, 221)
        tips = np.array([cls.tip(np.array([0.0, bend, bend])) - 3 for bend in bends])
        best = int(np.abs(np.hypot(*tips.T) - np.hypot(dx, dy)).argmin())
        first = np.arctan2(dy, dx) - np.arctan2(tips[best, 1], tips[best, 0])
        middle = (round(float(first), 2), round(float(bends[best]), 2), round(float(bends[best]), 2))
        return {name: (round(at - 0.15, 4), round(at + 0.15, 4)) for name, at in zip(cls.state, middle, strict=True)}

    @classmethod
    def tip(cls, angles: Array) -> Array:
        """Its place: (..., 3) -> (..., 2)."""
        total = np.cumsum(angles, axis=-1)
        return np.stack([3 + np.cos(total) @ cls.links, 3 + np.sin(total) @ cls.links], axis=-1)

    def signals(self, state: Array) -> Array:
        """x, y of the tip: (..., 3) -> (..., 2)."""
        return self.tip(state)

    def scaled_state(self, state: Array) -> Array:
        """Cosine and sine of each angle: (N, 3) -> (N, 6)."""
        return np.concatenate([np.cos(state), np.sin(state)], axis=1)


class Pair(Integrator):
    """Two points whose velocities are controlled, and which keep a distance of 0.5 m: p' = p + dt v."""

    state = ("ax", "ay", "bx", "by")
    about = About(
        ranges={name: ROOM for name in state},
        axes={name: (-1.0, 1.0, 5, "m/s") for name in ("va_x", "va_y", "vb_x", "vb_y")},
        robots={"a": ("va_x", "va_y"), "b": ("vb_x", "vb_y")},
        points=(("ax", "ay"), ("bx", "by")),
        always="norm(ax - bx, ay - by) >= 0.5",
        pace=0.9,
        settle=0.5,
        top=2**0.5,
    )


SYSTEMS: Mapping[str, type[SuiteSystem]] = {
    "integrator": Integrator,
    "double-integrator": DoubleIntegrator,
    "unicycle": Unicycle,
    "quadrotor": Quadrotor,
    "cart-pendulum": CartPendulum,
    "arm": Arm,
    "pair": Pair,
}
"""Systems by the name that tasks have."""
