"""Environments by the name that Gymnasium has for them, and which software they consist of."""

from __future__ import annotations

import os
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from importlib.metadata import PackageNotFoundError, packages_distributions, requires, version
from types import ModuleType
from typing import Any, TypeAlias

import gymnasium

from stlbench.contract import cause
from stlbench.errors import UsageError, did_you_mean
from stlbench.task.file import Api
from stlbench.task.gym_joint import JointEnv

Gym: TypeAlias = gymnasium.Env[Any, Any]

_EXTRAS = {
    "Box2D": "field",
    "dm_control": "dm",
    "gymnasium_robotics": "mujoco",
    "highway_env": "field",
    "mpe2": "petting",
    "mujoco": "mujoco",
    "pettingzoo": "petting",
    "pygame": "field",
    "shimmy": "dm",
}
"""Library of environments -> the extra that brings it."""

_OURS = frozenset({"numpy", "stlbench"})
"""Every task is computed with these. Their versions are in no key of an environment."""

_ENGINES = frozenset({"box2d", "box2d-py", "brax", "mujoco", "mujoco-mjx", "pybullet", "pymunk"})
"""Distributions that compute motions for the libraries that need them."""


def without_display() -> None:
    """Tell libraries that draw that there is no display. To be called before they are imported."""
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")  # its own choice needs a display
        os.environ.setdefault("XDG_RUNTIME_DIR", tempfile.gettempdir())  # else SDL complains of it


def made(identifier: str, keywords: Mapping[str, Any], api: Api = "gymnasium") -> Gym:
    """The environment of an id, "CartPole-v1" or "a_module_that_registers_it:Id-v0", without its time limit.

    For the API `pettingzoo` the id is a module with `parallel_env`, as "mpe2.simple_spread_v3"; its agents act jointly.
    Raises `UsageError`: an unknown id, a library that is missing, keywords that the environment does not take.
    """
    without_display()
    module, _, name = identifier.rpartition(":")
    try:
        if api == "pettingzoo":
            return JointEnv(import_module(identifier).parallel_env(**keywords))
        if module:
            import_module(module)
        if "/" not in name and name not in gymnasium.registry:  # else Gymnasium takes the latest version of a name
            raise gymnasium.error.NameNotFound
        return gymnasium.make(identifier, max_episode_steps=-1, disable_env_checker=True, **keywords)
    except UsageError:
        raise
    except gymnasium.error.NameNotFound as error:
        raise UsageError(f"no environment '{identifier}'{_hint(identifier)}") from error
    except Exception as error:
        kind = "environment" if api == "gymnasium" else "parallel environment"
        raise failed(f"{kind} {identifier}", error) from error


def failed(what: str, error: Exception) -> UsageError:
    """The error of an environment that cannot be made, which may raise anything."""
    missing = _missing(error)
    if missing in _EXTRAS:
        return UsageError(f'{what} needs {missing}: pip install "stlbench-rl[{_EXTRAS[missing]}]"')
    return UsageError(f"{what} cannot be made: {cause(error)}")


def _hint(identifier: str) -> str:
    """A similar id, as there are too many to name all."""
    if re.fullmatch(r"[a-z]\w*(\.\w+)+", identifier):
        return "; a module with parallel environments of PettingZoo is named in a task file, with `api: pettingzoo`"
    module, colon, name = identifier.rpartition(":")
    near = [f"{module}{colon}{each}" for each in get_close_matches(name, gymnasium.registry, n=1, cutoff=0.6)]
    return did_you_mean(near[0], near) if near else "; `gymnasium.pprint_registry()` lists all"


def _missing(error: BaseException | None) -> str:
    while error is not None:
        if isinstance(error, ModuleNotFoundError) and error.name:
            return error.name.partition(".")[0]
        error = error.__cause__
    return ""


def software(env: Gym) -> tuple[tuple[str, str], ...]:
    """Distribution -> version, of the environment's modules, of what they import, and of their engines."""
    tops = {name.partition(".")[0] for name in _imported(type(env.unwrapped))} - _OURS
    names = {each for top in tops for each in _distributions().get(top, ())}
    names |= {engine for each in names for engine in _engines(each)}
    return tuple(sorted((name, _version(name)) for name in names))


def modules(env: Gym) -> tuple[str, ...]:
    """The modules of the environment's classes, of its wrappers, and of the entry point of its id."""
    entry: Any = getattr(env.spec, "entry_point", None)
    entry = entry.partition(":")[0] if isinstance(entry, str) else getattr(entry, "__module__", None)
    names = {base.__module__ for kind in _layers(env) for base in kind.__mro__}
    return tuple(sorted(names | ({entry} if entry else set())))


def _layers(env: Any) -> Iterator[type]:
    """The classes of its wrappers, the outermost first, and its own."""
    innermost = env.unwrapped
    while env is not innermost:
        yield type(env)
        env = getattr(env, "env", innermost)
    yield type(innermost)


def _imported(kind: type) -> Iterator[str]:
    for base in kind.__mro__:
        module = sys.modules.get(base.__module__)
        yield base.__module__
        for value in vars(module).values() if module else ():
            if isinstance(value, ModuleType):
                yield value.__name__


@cache
def _distributions() -> Mapping[str, list[str]]:
    return packages_distributions()


def _engines(distribution: str) -> Iterator[str]:
    for requirement in requires(distribution) or ():
        name, _, condition = requirement.partition(";")
        name = re.split(r"[^\w.-]", name.strip())[0].lower()
        if name in _ENGINES and "extra" not in condition:
            yield name


def _version(distribution: str) -> str:
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""
