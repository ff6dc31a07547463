"""Steps of Gymnasium's MuJoCo robots without what the harness does not read.

MuJoCo takes most of such a step. Most of the rest is for the reward, of which no score is made. Here a copy is
simulated and read by the environment's own functions, in its own memory. Observations, ends and what the info has at a
reset are those of its `step`, bit for bit.

MuJoCo's own batch, `mujoco.rollout`, does not give back from where the solver starts its next search. Without it, the
next step has other bits. Nor does it give back the contact forces, which Ant and Humanoid observe.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gymnasium.wrappers import OrderEnforcing

from stlbench.task.gym_make import Gym

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
"""Modules and classes whose `step` simulates, ends where the robot is not healthy, if it knows health, and has in its
info what a reset has, beside rewards and speeds."""


def is_robot(env: Gym) -> bool:
    """Whether `robot_step` makes its steps: a class that is known, with no other wrapper and no function replaced."""
    robot: Any = env.unwrapped
    name = f"{type(robot).__module__.removeprefix('gymnasium.envs.mujoco.')}:{type(robot).__qualname__}"
    bare = type(env) is OrderEnforcing and env.env is robot
    return bare and name in _ROBOTS and not any(map(callable, vars(robot).values()))


def robot_step(env: Gym, action: Any) -> tuple[Any, bool, Mapping[str, Any]]:
    """The observation, whether the episode is over, and of the info what a reset has."""
    robot: Any = env.unwrapped
    robot.do_simulation(action, robot.frame_skip)
    over = getattr(robot, "_terminate_when_unhealthy", False) and not robot.is_healthy
    return robot._get_obs(), bool(over), robot._get_reset_info()
