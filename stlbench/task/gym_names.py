"""Names of the entries of observations of Gymnasium's environments, in their order, from its documentation."""

from __future__ import annotations

from collections.abc import Mapping

_OF: Mapping[str, str] = {
    "Acrobot": "cos1 sin1 cos2 sin2 omega1 omega2",
    "CartPole": "x v theta omega",
    "HalfCheetah": "z angle bthigh bshin bfoot fthigh fshin ffoot "
    "vx vz omega v_bthigh v_bshin v_bfoot v_fthigh v_fshin v_ffoot",
    "Hopper": "z angle thigh leg foot vx vz omega v_thigh v_leg v_foot",
    "InvertedPendulum": "x theta v omega",
    "LunarLander": "x y vx vy angle omega left right",
    "LunarLanderContinuous": "x y vx vy angle omega left right",
    "MountainCar": "position velocity",
    "MountainCarContinuous": "position velocity",
    "Pendulum": "x y omega",
    "Reacher": "cos1 cos2 sin1 sin2 target_x target_y omega1 omega2 dx dy",
    "Swimmer": "angle rotor1 rotor2 vx vy omega v_rotor1 v_rotor2",
    "Walker2d": "z angle thigh leg foot left_thigh left_leg left_foot "
    "vx vz omega v_thigh v_leg v_foot v_left_thigh v_left_leg v_left_foot",
}
"""Id without version -> names."""


def names_of(identifier: str, count: int) -> list[str] | None:
    """The names for an environment's `count` entries; None of one that is not listed, or has another number."""
    names = _OF.get(identifier.rpartition("-v")[0], "").split()
    return names if len(names) == count else None
