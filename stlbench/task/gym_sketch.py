"""A first draft of a task file for an environment, with the names of its observation's entries. The user has to
write the formula.
"""

import time
import warnings
from collections.abc import Iterable, Iterator, Mapping
from math import ceil, floor, inf, log10, prod
from typing import Any, NamedTuple, TypeAlias

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Space

from stlbench import stl
from stlbench.contract import Array
from stlbench.errors import UsageError, cause
from stlbench.registry.plugins import PluginWarning
from stlbench.stl.language.expressions import DOTS
from stlbench.task.gym_make import Gym, begun, made, stepped
from stlbench.task.gym_spaces import LARGE, Entries, Names, Observed, entries_of, outside_space

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
    """The names for an environment's `count` entries; `o27`, ... if an entry has no documented meaning.

    None for an environment that is not listed, and for one with another number of entries: its options are others.
    """
    environment = identifier.rpartition("-v")[0]
    environment = _ALIKE.get(environment, environment)
    names = _OF.get(environment, "").split()
    if count == len(names) + _UNNAMED.get(environment, 0):
        names += [f"o{place}" for place in range(len(names), count)]
    return names if len(names) == count else None


_STEPS, _SECONDS = 200, 0.05
"""The steps of an episode and the seconds of a step, if the environment does not say."""

_EPISODES, _PLAYED = 20, 10_000
"""Episodes of random actions, which show the magnitude of entries without ends; the most steps of all together."""

_LEAST = 20
"""Steps that are played however slow the environment is."""

_KEPT = 10
"""Steps for which every other episode keeps an action: noise that changes at each step hardly moves a body."""

_FLOOR = 0.1
"""No scale is less than this share of the median of all. Random actions hardly move some entries, such as the speed of
an object that they never touch, and a trained policy moves them."""

_MOST = 500
"""Entries that a draft names. Pictures have thousands, none with a meaning."""


def sketch(
    identifier: str, keywords: Mapping[str, Any] | None = None, seconds: float | None = None, *, timed: bool = False
) -> dict[str, Any]:
    """The content of a `task.yaml` on an environment, with a formula that is there to be changed.

    Args:
        identifier: the id that `gymnasium.make` takes.
        keywords: the arguments with which the environment is made.
        seconds: the wall time after which no more is played, for a slow environment.
        timed: whether the seconds of a step count. The notes then say what they are by.

    Entries without ends get a scale, and signals on them a range, by the magnitudes that random actions show. Entries
    that these hardly move get a scale by the others. Entries that leave their ends count as without, with a warning.

    Raises:
        UsageError: the environment cannot be made or played. Or its observation is no array of numbers and no Dict with
            one, or has more numbers than anybody would name. Or it is `timed`, and does not say the seconds of a step.
    """
    env = made(identifier, keywords or {})
    step, said = _step(env)
    if timed and not said:
        rule = "give its class `dt = 0.05`, or name the folder of a task file with `sampling_time`"
        raise UsageError(f"environment {identifier} does not say the seconds of a step, for --time seconds; {rule}")
    names, known = _entries(env.observation_space, identifier)
    samples = _samples(identifier, env, entries_of(env.observation_space, names), seconds)
    known |= dict.fromkeys(samples.outside, (None, None))
    without = [name for name, pair in known.items() if None in pair]
    seen = _magnitudes(known, samples.named) if without else {}
    scale = {name: seen[name] for name in without}
    # Twice what random actions show, as a trained policy gets farther than they do.
    ends = {name: _completed(pair, 2 * scale.get(name, 0)) for name, pair in known.items()}
    first, (low, high) = next(iter(ends.items()))
    steps, middle = _limit(identifier), (low + high) / 2
    distance = f"abs({first} - {middle:g})" if middle else f"abs({first})"
    return {
        "title": f"A task on {identifier}",
        "source": identifier,
        **({"notes": f"a step is {step:g} s, by the environment's {said}"} if timed else {}),
        "environment": {"id": identifier}
        | ({"kwargs": dict(keywords)} if keywords else {})
        | {"names": names}
        | ({"scale": scale} if scale else {}),
        "formula": f"G[0,{steps}] {distance} <= {(high - low) / 4:g}",
        "sampling_time": step,
        "steps": steps,
        "signals": {name: {"low": low, "high": high} for name, (low, high) in ends.items()},
        "budgets": {
            "smoke": {"steps": 16 * steps, "seeds": 1, "deadline": 300, "checkpoints": 2, "random_starts": 20},
            "quick": {"steps": 100_000, "seeds": 3, "deadline": 900, "random_starts": 100},
        },
    }


_Ends: TypeAlias = tuple[float | None, float | None]
"""The least and the greatest value of an entry; None where its space does not say."""


def _completed(ends: _Ends, most: float) -> tuple[float, float]:
    """The ends; the magnitude `most` stands in for one that is not known."""
    low, high = ends
    return -most if low is None else low, most if high is None else high


def _entries(space: Space[Any], identifier: str) -> tuple[Names, dict[str, _Ends]]:
    """Names as a task file has them, and name -> ends."""
    whole = isinstance(space, Box)
    parts = {"o": space} if whole else dict(space.spaces) if isinstance(space, Dict) else {}
    boxes = {key: part for key, part in parts.items() if isinstance(part, Box)}
    count = sum(prod(part.shape) for part in boxes.values())
    if not count:
        raise UsageError(f"its observation is no Box, nor a Dict with one: {space}; write the task file by hand")
    if count > _MOST:
        by_hand = "write the task file by hand, with signals over entries of the info, or a class of GymTask"
        raise UsageError(f"its observation has {count} numbers, more than the {_MOST} that are named here; {by_hand}")
    documented = names_of(identifier, count) if whole else None
    named = {"o": documented} if documented else _numbered(boxes)
    ends = {name: pair for key, box in boxes.items() for name, pair in zip(named[key], _ends(box), strict=True)}
    return named["o"] if whole else named, ends


def _numbered(boxes: Mapping[str, Box]) -> dict[str, list[str]]:
    """Key -> `o0`, `o1`, ..., or the key itself if there is one entry; all differ."""
    named, taken = dict[str, list[str]](), set[str]()
    for key, box in boxes.items():
        numbers = [""] if prod(box.shape) == 1 else map(str, range(prod(box.shape)))
        names = [_as_signal(f"{key}{number}") for number in numbers]
        while taken.intersection(names):
            names = [f"{name}_" for name in names]
        taken.update(names)
        named[key] = names
    return named


def _as_signal(name: str) -> str:
    """The name as a formula can have it: `x_y` for "x y", and `o_min` for the name of a function."""
    plain = "".join(each if each not in DOTS and f"_{each}".isidentifier() else "_" for each in name)
    try:
        return plain if [*stl.signals(stl.parse_expression(plain))] == [plain] else f"o_{plain}"
    except stl.StlSyntaxError:
        return f"o_{plain}"


def _ends(space: Box) -> list[_Ends]:
    pairs = zip(space.low.ravel().tolist(), space.high.ravel().tolist(), strict=True)
    return [_rounded(low, high) if low < high else (None, None) for low, high in pairs]


def _rounded(low: float, high: float) -> _Ends:
    """The ends to four digits, unless they are equal then."""
    rounded = _said(low), _said(high)
    return (float(low), float(high)) if None not in rounded and rounded[0] == rounded[1] else rounded


def _said(end: float) -> float | None:
    """The end to four digits; None if it is so large that it says nothing (`gym_spaces.LARGE`)."""
    return float(f"{end:.4g}") if abs(end) <= LARGE else None


class _Samples(NamedTuple):
    """The ranges of the observations in episodes of random actions."""

    named: Array
    """The magnitudes (N, e) of the named entries."""
    outside: list[str]
    """The named entries that left the ends of their space."""


def _samples(identifier: str, env: Gym, entries: Entries, seconds: float | None) -> _Samples:
    """Warns of each entry that leaves its ends, at its first step."""
    observed = Observed(env.observation_space, entries, {})
    try:
        played = [
            (entries.read(each, 1)[0], observed.flat(each), t)
            for each, _, t in _played(env, _limit(identifier), seconds)
        ]
        left = observed.beyond(observed.scaled(np.array([flat for _, flat, _ in played])))
    except Exception as error:  # it is code of others
        raise _unplayable(identifier, error) from error
    rule = f"its range is by what {_EPISODES} episodes of random actions show; check it"
    for row, _, said in left:
        problem = outside_space(said, f"at step {played[row][2]}")
        warnings.warn(f"environment {identifier}: {problem}; {rule}", PluginWarning, stacklevel=3)
    return _Samples(np.abs([values for values, *_ in played]), [name for _, name, _ in left if name])


def _unplayable(identifier: str, error: Exception) -> UsageError:
    said = error if isinstance(error, UsageError) else cause(error)
    return UsageError(f"environment {identifier} cannot be played: {said}")


def _magnitudes(names: Iterable[str], seen: Array) -> dict[str, float]:
    """Name -> the largest magnitude of the entry, above the floor, rounded up."""
    most: Array = np.max(np.nan_to_num(seen, posinf=0.0), axis=0)
    floor = _FLOOR * float(np.median(most[most > 0])) if most.any() else 1.0
    return {name: _rounded_up(max(value, floor)) for name, value in zip(names, most.tolist(), strict=True)}


def info_ends(
    identifier: str, keywords: Mapping[str, Any], seconds: float | None = None
) -> dict[str, tuple[float, float]]:
    """The numbers in every info of the environment, name -> range, from episodes of random actions.

    A flag, of which only 0 and 1 were seen, lies in [0, 1], even if it was always the same. Other ranges reach to
    twice the largest magnitude that was seen, on the sides of 0 that had values. Raises `UsageError` if the environment
    cannot be made or played.
    """
    env, infos = made(identifier, keywords), list[dict[str, float]]()
    try:
        infos += [_numbers(info) for _, info, _ in _played(env, _limit(identifier), seconds)]
    except Exception as error:  # it is code of others
        raise _unplayable(identifier, error) from error
    always = [name for name in infos[0] if all(name in info for info in infos)]
    return {name: _range([info[name] for info in infos]) for name in always}


def _numbers(info: Mapping[str, Any]) -> dict[str, float]:
    kinds = bool, int, float, np.bool_, np.number
    return {name: float(value) for name, value in info.items() if isinstance(value, kinds) and np.isfinite(value)}


def _range(values: list[float]) -> tuple[float, float]:
    if {*values} <= {0.0, 1.0}:
        return 0.0, 1.0
    most = 2 * _rounded_up(max(map(abs, values)))
    return -most if min(values) < 0 else 0.0, most if max(values) > 0 else 0.0


def _played(env: Gym, steps: int, seconds: float | None) -> Iterator[tuple[Any, Mapping[str, Any], int]]:
    """Each observation with its info and its step."""
    env.action_space.seed(0)
    count, began = 0, time.perf_counter()
    for seed in range(_EPISODES):
        yield *begun(env, seed=seed), 0
        for t in range(min(steps, _PLAYED // _EPISODES)):
            if seed % 2 == 0 or t % _KEPT == 0:
                action = env.action_space.sample()
            observation, _, terminated, truncated, info = stepped(env, action)
            yield observation, info, t + 1
            count += 1
            if seconds is not None and count >= _LEAST and time.perf_counter() - began > seconds:
                return
            if terminated or truncated:
                break


def _rounded_up(value: float) -> float:
    """The least of 1, 2 or 5 times a power of ten that is not below a positive value."""
    power = 10.0 ** floor(log10(value))
    digit = next(each for each in (1, 2, 5, 10) if ceil(value / power) <= each)
    return float(f"{digit * power:.1g}")


def _limit(identifier: str) -> int:
    return gymnasium.spec(identifier.rpartition(":")[2]).max_episode_steps or _STEPS


def _step(env: Gym) -> tuple[float, str]:
    """The seconds of a step, and what of the environment says them: nothing where they are only a default."""
    own, rate = getattr(env.unwrapped, "dt", None), env.metadata.get("render_fps")
    if isinstance(own, int | float | np.integer | np.floating) and not isinstance(own, bool) and 0 < own < inf:
        return round(float(own), 12), "dt"
    return (round(1 / rate, 12), f"render_fps of {rate:g}") if rate else (_SECONDS, "")
