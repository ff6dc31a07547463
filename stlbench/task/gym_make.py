"""Environments by the name that Gymnasium or PettingZoo has for them: which software they consist of, their calls
checked, several agents as one.
"""

import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from difflib import get_close_matches
from importlib import import_module
from importlib.metadata import PackageNotFoundError, requires, version
from importlib.util import find_spec
from traceback import walk_tb
from types import ModuleType
from typing import Any, TypeAlias

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, Discrete, MultiDiscrete, Space

from stlbench.errors import UsageError, cause, did_you_mean, one_line
from stlbench.registry.fingerprint import distributions
from stlbench.task.file import Api
from stlbench.task.gym_spaces import as_action

_RESET = "the environment's reset returns an observation and an info"
_STEP = "the environment's step returns observation, reward, terminated, truncated, info"

_SEEDED = "the environment's reset takes a seed and options, `def reset(self, *, seed=None, options=None)`"

_OTHER_API = re.compile(r"values to unpack|unexpected keyword argument '(seed|options)'|has no attribute 'items'")
"""Python's errors when the caller of an environment of another API trips over it."""


def begun(env: Any, **options: Any) -> tuple[Any, Any]:
    """The result of `env.reset(**options)`: observation and info. Raises `UsageError` if it is not of Gymnasium."""
    observation, info = _returned(_RESET, 2, lambda: env.reset(**options))
    return observation, info


def stepped(env: Any, action: Any) -> tuple[Any, Any, Any, Any, Any]:
    """The result of `env.step(action)`. Raises `UsageError` if it is not the five values of Gymnasium."""
    observation, reward, terminated, truncated, info = _returned(_STEP, 5, lambda: env.step(action))
    return observation, reward, terminated, truncated, info


@contextmanager
def blaming(name: str) -> Iterator[None]:
    """Turn the errors of an environment that is reset or stepped here into a `UsageError`.

    An error from elsewhere, as of stlbench itself, is raised as it is: it is a defect, and its traceback says where.
    """
    try:
        yield
    except UsageError:
        raise
    except Exception as error:  # it is code of others
        if not any(frame.f_code is _returned.__code__ for frame, _ in walk_tb(error.__traceback__)):
            raise
        raise UsageError(f"environment {name} cannot be played: {cause(error)}") from error


def _returned(rule: str, count: int, call: Callable[[], Any]) -> Any:
    try:
        given = call()
    except (AttributeError, TypeError, ValueError) as error:
        # The environment's own code may raise the same words for another reason.
        if not _OTHER_API.search(str(error)) or not _of_caller(error):
            raise
        rule = _SEEDED if "keyword argument" in str(error) else rule
        raise UsageError(f"{rule}; its caller says: {one_line(error)}") from error
    if not (isinstance(given, tuple) and len(given) == count and isinstance(given[-1], Mapping)):
        raise UsageError(f"{rule}, got {one_line(given)}")
    return given


def _of_caller(error: BaseException) -> bool:
    """Whether the environment's caller raised it, which is this module, or a wrapper of a library in between."""
    module = str([frame.f_globals.get("__name__") for frame, _ in walk_tb(error.__traceback__)][-1])
    return module == __name__ or module.startswith(("gymnasium.", "pettingzoo."))


class JointEnv(gymnasium.Env[Any, Any]):
    """All agents of a parallel environment, in lock-step.

    The observation is a Dict, agent -> observation. The action joins the agents' actions. The info has the entries of
    each agent as `agent_entry`. An episode is over when all agents are over. An agent that is over before keeps its
    last observation and info, and gets no actions.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - declared so by Gymnasium

    def __init__(self, env: Any) -> None:
        """Args: `env` a PettingZoo `ParallelEnv`. Raises `UsageError` if the agents' actions have no common space."""
        self.env, self._names = env, tuple(env.possible_agents)
        self.metadata = {"render_modes": list(getattr(env, "metadata", {}).get("render_modes", ()))}
        self.render_mode = getattr(env, "render_mode", None)
        self._spaces = {name: env.action_space(name) for name in self._names}
        self.observation_space = Dict({name: env.observation_space(name) for name in self._names})
        self.action_space = _joined(self._spaces)
        sizes = [int(np.prod(space.shape)) if isinstance(space, Box) else 1 for space in self._spaces.values()]
        self._ends = np.cumsum(sizes)[:-1].tolist()

    @property
    def unwrapped(self) -> Any:
        """The parallel environment, whose software is in the keys of cells."""
        return self.env.unwrapped

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        observations, infos = begun(self.env, seed=seed, options=options)
        self._last, self._infos = dict(observations), dict(infos)
        return dict(self._last), _flat(self._infos)

    def render(self) -> Any:
        return self.env.render()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One step by a joint action (axes,); the reward is the sum of all agents'."""
        own = dict(zip(self._names, np.split(np.ravel(action), self._ends), strict=True))
        actions = {name: as_action(self._spaces[name], own[name]) for name in self.env.agents}
        observations, rewards, terminations, truncations, infos = stepped(self.env, actions)
        self._last |= observations
        self._infos |= infos
        over = not self.env.agents or all(terminations[name] or truncations[name] for name in terminations)
        return dict(self._last), float(sum(rewards.values())), over, False, _flat(self._infos)


def _joined(spaces: Mapping[str, Space[Any]]) -> Space[Any]:
    each: list[Any] = list(spaces.values())
    if all(isinstance(space, Box) for space in each):
        low, high = (np.concatenate([np.ravel(ends) for ends in side]) for side in zip(*map(_ends, each), strict=True))
        return Box(low, high)
    if all(isinstance(space, Discrete) for space in each):
        return MultiDiscrete([int(space.n) for space in each], start=[int(space.start) for space in each])
    named = ", ".join(map(str, each))
    raise UsageError(f"the actions of all agents should be Boxes, or all Discrete, they are {named}")


def _ends(space: Any) -> tuple[Any, Any]:
    return space.low.astype(np.float32), space.high.astype(np.float32)  # agents may have spaces of several types


def _flat(infos: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    return {f"{agent}_{name}": value for agent, info in infos.items() for name, value in info.items()}


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


def without_notices() -> None:
    """Drop the notices that Farama's libraries print when they are imported: of rewards, which nothing here uses."""
    with suppress(ImportError):
        import_module("farama_notifications").notifications.clear()


def made(identifier: str, keywords: Mapping[str, Any], api: Api = "gymnasium", limit: int | None = -1) -> Gym:
    """The environment of an id, "CartPole-v1" or "a_module_that_registers_it:Id-v0".

    It has no time limit, or with the `limit` None that of its id.

    For the API `pettingzoo` the id is a module with `parallel_env`, as "mpe2.simple_spread_v3"; its agents act jointly.
    Raises `UsageError`: an unknown id, a library that is missing, keywords that the environment does not take.
    """
    without_display()
    without_notices()
    module, _, name = identifier.rpartition(":")
    try:
        if api == "pettingzoo":
            return JointEnv(import_module(identifier).parallel_env(**keywords))
        if module:
            import_module(module)
        if "/" not in name and name not in gymnasium.registry:  # else Gymnasium takes the latest version of a name
            raise gymnasium.error.NameNotFound
        return gymnasium.make(identifier, max_episode_steps=limit, disable_env_checker=True, **keywords)
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
    hint = "; set PYTHONPATH=. if it lies here" if missing else ""
    return UsageError(f"{what} cannot be made: {cause(error)}{hint}")


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
            library = error.name.partition(".")[0]
            there = sys.modules.get(library) or find_spec(library)  # then only a module of it is missing
            return "" if there else library
        error = error.__cause__
    return ""


def software(env: Gym) -> tuple[tuple[str, str], ...]:
    """Distribution -> version, of the environment's modules, of what they import, and of their engines."""
    tops = {name.partition(".")[0] for name in _imported(type(env.unwrapped))} - _OURS - sys.stdlib_module_names
    names = {each for top in tops for each in distributions(top)}
    names |= {engine for each in names for engine in _engines(each)}
    return tuple(sorted((name, _version(name)) for name in names))


def modules(env: Gym) -> tuple[str, ...]:
    """The modules of the environment's classes, of its wrappers, and of the entry point of its id."""
    entry: Any = getattr(env.spec, "entry_point", None)
    entry = entry.partition(":")[0] if isinstance(entry, str) else getattr(entry, "__module__", None)
    names = {base.__module__ for kind in layers(env) for base in kind.__mro__}
    return tuple(sorted(names | ({entry} if entry else set())))


def layers(env: Any) -> Iterator[type]:
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
