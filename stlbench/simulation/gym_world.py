"""The world of an environment of Gymnasium, copy by copy: it may be random, stateful, and written in any language."""

import weakref
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.wrappers import OrderEnforcing

from stlbench.contract import Array, GymTask, Integers, World
from stlbench.contract.presentation import Pixels
from stlbench.errors import UsageError
from stlbench.task.gym_make import Gym, begun, stepped
from stlbench.task.gym_source import GymSource
from stlbench.task.gym_spaces import as_action


class GymWorld(World):
    """N copies of an environment, from seeds (r, 1). A copy has ended once it is terminated or truncated."""

    def __init__(self, task: GymTask, source: GymSource, count: int, *, drawn: bool = False) -> None:
        self._task, self._source, self._drawn = task, source, drawn
        self._copies = source.borrow(count, drawn=drawn)
        weakref.finalize(self, source.give_back, self._copies, drawn=drawn)  # copies are dear to make: the next borrows
        self._seen = np.zeros((count, source.observed.size))
        self._last: list[tuple[Any, Mapping[str, Any]]] = [(None, {})] * count
        self.signals = np.zeros((count, len(source.signals)))
        self.ended, self.lived = np.ones(count, dtype=np.bool_), np.zeros(count, dtype=np.int64)
        # a class that reads signals may look at what `robot_step` leaves out of the info
        self._robots = source.function is None and all(map(is_robot, self._copies))

    def restart(self, rows: Integers, starts: Array) -> None:
        for row, seed in zip(rows.tolist(), starts[:, 0].tolist(), strict=True):
            self._last[row] = self._begun(row, int(seed))
        self.ended[rows], self.lived[rows] = False, 0
        self.signals[rows] = self._read(rows)

    def advance(self, action: Array, steps: int) -> Array:
        """Raises `UsageError` where an observation is outside its space, or a signal is missing."""
        samples = np.empty((steps + 1, *self.signals.shape))
        samples[0] = self.signals
        taken = [as_action(self._source.action_space, vector) for vector in action]
        for i in range(1, steps + 1):
            rows = np.flatnonzero(~self.ended)
            for row in rows.tolist():
                self._step(row, taken[row])
            self.lived[rows] += 1
            samples[i] = samples[i - 1]
            if len(rows):
                samples[i, rows] = self._read(rows)
        self.signals = samples[-1].copy()
        return samples

    def features(self, t: Integers) -> Array:
        return self._source.observed.scaled(self._seen)

    def frames(self) -> tuple[Pixels, ...] | None:
        if not self._drawn:
            return None
        pictures = tuple(np.asarray(copy.render()) for copy in self._copies)
        if any(picture.ndim != 3 or picture.shape[2] != 3 or picture.dtype != np.uint8 for picture in pictures):
            raise RuntimeError("the environment's render() returns no picture (height, width, 3) of uint8")
        return pictures

    def by_hand(self, t: Integers) -> Array | None:
        self._robots = False  # a controller, too, may look at all of the info of the steps to come
        each = zip(self._last, t.tolist(), strict=True)
        actions = [self._task.controller(observation, info, at) for (observation, info), at in each]
        return None if any(action is None for action in actions) else np.array(actions, dtype=np.float64)

    def _begun(self, row: int, seed: int) -> tuple[Any, Mapping[str, Any]]:
        copy, space = self._copies[row], self._source.action_space
        sample = begun(copy, seed=seed)
        if copy.action_space != space:
            raise UsageError(f"the environment changed its action space, from {space} to {copy.action_space}")
        return sample

    def _step(self, row: int, action: Any) -> None:
        copy = self._copies[row]
        if self._robots:
            observation, self.ended[row], info = robot_step(copy, action)
        else:
            observation, _, terminated, truncated, info = stepped(copy, action)
            self.ended[row] = bool(terminated or truncated)
        self._last[row] = observation, info

    def _read(self, rows: Integers) -> Array:
        """The signals (r, k) of the newest observations of these rows, which `features` reads too."""
        self._seen[rows], signals = self._source.read([self._last[row] for row in rows.tolist()])
        return signals


_ROBOTS = {
    "ant_v5:AntEnv",
    "half_cheetah_v5:HalfCheetahEnv",
    "hopper_v5:HopperEnv",
    "humanoid_v5:HumanoidEnv",
    "humanoidstandup_v5:HumanoidStandupEnv",
    "pusher_v5:PusherEnv",
    "reacher_v5:ReacherEnv",
    "swimmer_v5:SwimmerEnv",
    "walker2d_v5:Walker2dEnv",
}
"""Modules and classes of robots. Their `step` simulates, and ends an episode if a robot that knows health is not
healthy. Its info has what a reset has, beside rewards and speeds."""


def is_robot(env: Gym) -> bool:
    """Whether `robot_step` makes its steps: a class that is known, with no other wrapper and no function replaced."""
    robot: Any = env.unwrapped
    name = f"{type(robot).__module__.removeprefix('gymnasium.envs.mujoco.')}:{type(robot).__qualname__}"
    bare = type(env) is OrderEnforcing and env.env is robot
    return bare and name in _ROBOTS and not any(map(callable, vars(robot).values()))


def robot_step(env: Gym, action: Any) -> tuple[Any, bool, Mapping[str, Any]]:
    """The observation, whether the episode is over, and of the info what a reset has.

    MuJoCo takes most of such a step. Most of the rest is for the reward, of which no score is made. Here a copy is
    simulated and read by the environment's own functions, in its own memory. Observations, ends and what the info has
    at a reset are those of its `step`, bit for bit.

    MuJoCo's own batch, `mujoco.rollout`, does not give back from where the solver starts its next search. Without it,
    the next step has other bits. Nor does it give back the contact forces, which Ant and Humanoid observe.
    """
    robot: Any = env.unwrapped
    robot.do_simulation(action, robot.frame_skip)
    over = getattr(robot, "_terminate_when_unhealthy", False) and not robot.is_healthy
    return robot._get_obs(), bool(over), robot._get_reset_info()
