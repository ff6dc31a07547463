"""Names of the entries of observations of Gymnasium's environments, in their order, from its documentation."""

from __future__ import annotations

from collections.abc import Mapping

_OF: Mapping[str, str] = {
    "Acrobot": "cos1 sin1 cos2 sin2 omega1 omega2",
    "Ant": "z q_w q_x q_y q_z hip_1 ankle_1 hip_2 ankle_2 hip_3 ankle_3 hip_4 ankle_4 vx vy vz omega_x omega_y omega_z "
    "v_hip_1 v_ankle_1 v_hip_2 v_ankle_2 v_hip_3 v_ankle_3 v_hip_4 v_ankle_4",
    "BipedalWalker": "angle omega vx vy hip_1 v_hip_1 knee_1 v_knee_1 contact_1 "
    "hip_2 v_hip_2 knee_2 v_knee_2 contact_2 lidar0 lidar1 lidar2 lidar3 lidar4 lidar5 lidar6 lidar7 lidar8 lidar9",
    "CartPole": "x v theta omega",
    "HalfCheetah": "z angle bthigh bshin bfoot fthigh fshin ffoot "
    "vx vz omega v_bthigh v_bshin v_bfoot v_fthigh v_fshin v_ffoot",
    "Hopper": "z angle thigh leg foot vx vz omega v_thigh v_leg v_foot",
    "Humanoid": "z q_w q_x q_y q_z abdomen_z abdomen_y abdomen_x right_hip_x right_hip_z right_hip_y right_knee "
    "left_hip_x left_hip_z left_hip_y left_knee right_shoulder1 right_shoulder2 right_elbow "
    "left_shoulder1 left_shoulder2 left_elbow vx vy vz omega_x omega_y omega_z "
    "v_abdomen_z v_abdomen_y v_abdomen_x v_right_hip_x v_right_hip_z v_right_hip_y v_right_knee "
    "v_left_hip_x v_left_hip_z v_left_hip_y v_left_knee v_right_shoulder1 v_right_shoulder2 v_right_elbow "
    "v_left_shoulder1 v_left_shoulder2 v_left_elbow",
    "InvertedDoublePendulum": "x sin1 sin2 cos1 cos2 v omega1 omega2 force",
    "InvertedPendulum": "x theta v omega",
    "LunarLander": "x y vx vy angle omega left right",
    "LunarLanderContinuous": "x y vx vy angle omega left right",
    "MountainCar": "position velocity",
    "MountainCarContinuous": "position velocity",
    "Pendulum": "x y omega",
    "Pusher": "shoulder_pan shoulder_lift upper_arm_roll elbow_flex forearm_roll wrist_flex wrist_roll "
    "v_shoulder_pan v_shoulder_lift v_upper_arm_roll v_elbow_flex v_forearm_roll v_wrist_flex v_wrist_roll "
    "tip_x tip_y tip_z object_x object_y object_z goal_x goal_y goal_z",
    "Reacher": "cos1 cos2 sin1 sin2 target_x target_y omega1 omega2 dx dy",
    "Swimmer": "angle rotor1 rotor2 vx vy omega v_rotor1 v_rotor2",
    "Walker2d": "z angle thigh leg foot left_thigh left_leg left_foot "
    "vx vz omega v_thigh v_leg v_foot v_left_thigh v_left_leg v_left_foot",
}
"""Id without version -> names."""

_ALIKE: Mapping[str, str] = {"HumanoidStandup": "Humanoid"}
"""Environments whose observations are those of another."""

_UNNAMED: Mapping[str, int] = {"Ant": 78, "Humanoid": 303}
"""Forces and inertias after the entries above, which the environment shows unless it is made without them."""


def names_of(identifier: str, count: int) -> list[str] | None:
    """The names for an environment's `count` entries, `o27`, ... for those without a documented meaning.

    None of an environment that is not listed, or whose number of entries is another: it was made with other options.
    """
    environment = identifier.rpartition("-v")[0]
    environment = _ALIKE.get(environment, environment)
    names = _OF.get(environment, "").split()
    if count == len(names) + _UNNAMED.get(environment, 0):
        names += [f"o{place}" for place in range(len(names), count)]
    return names if len(names) == count else None
