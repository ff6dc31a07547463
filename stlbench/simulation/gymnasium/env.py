"""A task with a reward method as an environment of Gymnasium; `stlbench.gym` registers and documents it."""

from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import InvalidAction, ResetNeeded
from gymnasium.spaces import Box, Discrete
from gymnasium.utils import EzPickle, seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from stlbench.contract import ActionGrid, Array, GymTask, Integers
from stlbench.contract.presentation import Drawn, Pixels
from stlbench.errors import UsageError, did_you_mean
from stlbench.registry.choices import choice_of
from stlbench.simulation.environment import Simulator
from stlbench.simulation.verdicts import EarlyEnds
from stlbench.simulation.worlds import observation_of
from stlbench.task import Task, build_method, load_task

Single = NDArray[np.float32]
Booleans = NDArray[np.bool_]
Info = dict[str, Any]


class _Copies:
    """N copies of a task under one clock, in Gymnasium's types: what both kinds of environment have in common."""

    metadata: Info
    render_mode: str | None

    def _make(self, task: str, method: str, scaled: bool, render_mode: str | None) -> tuple[Any, Any]:
        self.task = load_task(task)
        undrawn = _undrawn(self.task)
        modes = [] if undrawn else ["rgb_array"]
        decisions_per_second = 1 / (self.task.file.sampling_time * self.task.file.hold)
        self.metadata = type(self).metadata | {"render_modes": modes, "render_fps": max(1, round(decisions_per_second))}
        self.render_mode = render_mode if render_mode in modes else None
        if render_mode != self.render_mode:
            there = f"nothing, as {undrawn}" if undrawn else "rgb_array alone"
            gymnasium.logger.warn(f"task {task} renders {there}; render_mode is None, in place of {render_mode!r}")
        self.method = build_method(self.task, method)
        self._simulator = Simulator(self.task, self.method, drawn=self.render_mode is not None)
        self._scale = self.method.scale if scaled else 1.0
        self._running = False
        example = self._simulator.reset(self._draw(np.random.default_rng(0)))
        space = Box(-np.inf, np.inf, example.shape[1:], np.float32)
        observation_of(self.task, self.method, str(choice_of(method))).save_in(space)
        actions = self.task.actions
        if isinstance(actions, ActionGrid):
            return space, Discrete(actions.size)
        return space, Box(np.array(actions.low, np.float32), np.array(actions.high, np.float32))

    def _start(self, generators: Sequence[np.random.Generator], options: Info | None) -> tuple[Single, Info]:
        """Start an episode in each copy: observations (N, D), and signals (N, 1, k) and time of the first sample."""
        unknown = dict(options or {})
        state = unknown.pop("state", None)
        if unknown:
            name = next(iter(unknown))
            raise UsageError(f"reset: no option '{name}'{did_you_mean(name, ['state'])}")
        if state is None:
            states = np.concatenate([self._draw(generator) for generator in generators])
        else:
            states = self._checked(state, len(generators))
        observation = self._simulator.reset(states)
        self._running = True
        return observation.astype(np.float32), self._info(self._simulator.signals[:, None].copy())

    def _advance(self, action: NDArray[Any]) -> tuple[Single, Array, bool, Info]:
        """Hold the actions (N,) or (N, axes): observations (N, D), rewards (N,), the end, signals."""
        if not self._running:
            raise ResetNeeded("call reset() first: no episode is running")
        simulator, before = self._simulator, self._over()
        reward, samples = simulator.advance(action)
        if simulator.world.can_end:
            ends = EarlyEnds(self.method, self.task.file.terminated)
            reward = ends.standing_still(reward, before, simulator.world.ended, simulator.t, simulator.hold)
        at_end = bool(simulator.t[0] >= simulator.horizon)
        self._running = not at_end
        return simulator.observe().astype(np.float32), reward / self._scale, at_end, self._info(samples)

    def _pictures(self) -> tuple[Pixels, ...] | None:
        return None if self.render_mode is None else self._simulator.world.frames()

    def _over(self) -> Booleans:
        """Which copies (N,) have ended already, or are over for the method."""
        simulator = self._simulator
        ended = simulator.world.ended.copy()
        return ended | simulator.over(simulator.memory) if self.method.can_end else ended

    def _info(self, samples: Array) -> Info:
        return {"signals": samples, "t": self._simulator.t.copy()}

    def _draw(self, generator: np.random.Generator) -> Array:
        return self.task.starts.of_training(generator, 1)

    def _checked(self, state: Any, count: int) -> Array:
        names = self.task.system.state
        try:
            states = np.array(state, dtype=np.float64)
        except (TypeError, ValueError):
            states = np.empty(0)
        if states.shape not in ((len(names),), (count, len(names))) or not np.isfinite(states).all():
            raise UsageError(f"reset: the option 'state' takes finite numbers {', '.join(names)}, got {state!r}")
        return np.broadcast_to(states, (count, len(names)))


def _undrawn(task: Task) -> str:
    """Why a task has no pictures; nothing where it has."""
    if isinstance(task.dynamics, GymTask):
        return task.source.undrawn
    return "" if isinstance(task.dynamics, Drawn) else "the task has no picture of itself"


def _array(space: Any, action: Any) -> NDArray[Any]:
    """An action of the space as an array. Gymnasium has whole numbers of any type in a Discrete space and in a Box."""
    given = np.asarray(action)
    return given if given.dtype.kind == space.dtype.kind else given.astype(space.dtype)


def _got(space: Any, action: Any) -> str:
    """What was given, with its type if that is what is wrong."""
    wrong = isinstance(action, np.ndarray) and not np.can_cast(action.dtype, space.dtype)
    return f"got {action!r}" + (f" of {action.dtype}; it should be {space.dtype}" if wrong else "")


def _kind(space: Any) -> str:
    if isinstance(space, Discrete):
        return f"an index in 0..{space.n - 1}"
    return f"a vector between {space.low.tolist()} and {space.high.tolist()}"


class StlEnv(_Copies, gymnasium.Env[Single, Any], EzPickle):
    """One copy of a task with a reward method, as `gymnasium.make("stlbench/<task>-v0", method=...)` makes it.

    A pickle has how it was made, and not its episode: what is read from it has to be reset first.
    """

    metadata: Info = {"render_modes": ["rgb_array"]}  # noqa: RUF012 - declared so by Gymnasium; a copy knows its own

    def __init__(self, task: str, method: str, *, scaled: bool = False, render_mode: str | None = None) -> None:
        """The reward is the mean of the method's reward over the `hold` steps of an action, in the paper's units.

        Args:
            task: its name; the environment's id says it.
            method: a reward method with or without parameters, "funnel" or "flag[beta=10]".
            scaled: divide rewards by the method's `scale`, as training in stlbench does.
            render_mode: "rgb_array" or None. A task without a picture of itself takes None instead, with a warning, so
                that libraries which always ask for pictures can train on it.

        Raises:
            UsageError: no such method, or a wrong parameter; the message says what there is.
            Intractable, Unsuitable: the method does not fit the task (`stlbench.contract`).
        """
        EzPickle.__init__(self, task, method, scaled=scaled, render_mode=render_mode)
        self.observation_space, self.action_space = self._make(task, method, scaled, render_mode)

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Single, Info]:
        """Start an episode, from a state that `seed` determines or from `options={"state": [...]}`.

        Returns:
            The observation (D,); and an info with `signals` (1, k), the trace's first sample, and `t`, 0.
        """
        super().reset(seed=seed)
        observation, info = self._start([self.np_random], options)
        return observation[0], _first(info)

    def step(self, action: np.int64 | NDArray[np.floating]) -> tuple[Single, float, bool, bool, Info]:
        """Hold an action, an index or a vector (axes,), for `hold` steps.

        Returns:
            The observation (D,), the reward, False, whether the time limit is reached; and an info with `signals`
            (hold, k), the samples after each step, and `t`, the time of the last of them in steps.
        """
        if not self.action_space.contains(action):
            raise InvalidAction(f"an action is {_kind(self.action_space)}, {_got(self.action_space, action)}")
        observation, reward, at_end, info = self._advance(_array(self.action_space, action)[None])
        return observation[0], float(reward[0]), False, at_end, _first(info)

    def render(self) -> Pixels | None:
        """A picture (height, width, 3) of the current state; None without a render mode.

        Raises `RuntimeError`, in one line, where this machine lacks what it takes to draw.
        """
        pictures = self._pictures()
        return None if pictures is None else pictures[0]


def _first(info: Info) -> Info:
    return {"signals": info["signals"][0], "t": int(info["t"][0])}


class StlVectorEnv(_Copies, gymnasium.vector.VectorEnv[Single, Any, NDArray[Any]], EzPickle):
    """N copies in lock-step, computed at once. They share the clock, so all episodes end at the same step.

    They do what N copies of `StlEnv` in a `gymnasium.vector.SyncVectorEnv` with the same autoreset mode do, number
    for number. But `reset` takes one seed, and no list of them.
    """

    metadata: Info = {  # noqa: RUF012 - declared so by Gymnasium; an instance knows its own
        "render_modes": ["rgb_array"],
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self, num_envs: int, task: str, method: str, *, scaled: bool = False, render_mode: str | None = None
    ) -> None:
        EzPickle.__init__(self, num_envs, task, method, scaled=scaled, render_mode=render_mode)
        if num_envs < 1:
            raise UsageError(f"num_envs must be at least 1, got {num_envs}")
        self.num_envs, spaces = num_envs, self._make(task, method, scaled, render_mode)
        self.single_observation_space, self.single_action_space = spaces
        self.observation_space, self.action_space = (batch_space(space, num_envs) for space in spaces)
        self._generators: list[np.random.Generator] = []

    def reset(self, *, seed: int | None = None, options: Info | None = None) -> tuple[Single, Info]:
        """Start N episodes; copy i starts where an `StlEnv` starts that is given seed + i.

        `options={"state": ...}` takes one state for all copies, or N states.

        Returns:
            Observations (N, D); and an info with `signals` (N, 1, k) and `t` (N,).
        """
        super().reset(seed=seed)
        if seed is not None or not self._generators:  # without a seed, episodes go on with the same random numbers
            seeds = [None if seed is None else seed + i for i in range(self.num_envs)]
            self._generators = [seeding.np_random(each)[0] for each in seeds]
        observation, info = self._start(self._generators, options)
        return observation, self._masked(info)

    def step(self, actions: Integers | NDArray[np.floating]) -> tuple[Single, Array, Booleans, Booleans, Info]:
        """Hold actions, indices (N,) or vectors (N, axes), for `hold` steps.

        Returns:
            Observations (N, D), rewards (N,), terminations (N,), truncations (N,), and an info with `signals`
            (N, hold, k) and `t` (N,). At the time limit the observations and the info are already those of the next
            episode. The info has the last ones of the old episode as `final_obs` and `final_info`.
        """
        if not self.action_space.contains(actions):
            rule = f"{self.num_envs} actions, each {_kind(self.single_action_space)}"
            raise InvalidAction(f"{rule}, {_got(self.action_space, actions)}")
        observation, reward, at_end, info = self._advance(_array(self.action_space, actions))
        if at_end:
            final_obs = np.empty(self.num_envs, dtype=object)  # (N,), each a vector (D,), as Gymnasium gives them
            final_obs[:] = list(observation)
            last = {"final_obs": final_obs, "final_info": self._masked(info)}
            observation, info = self._start(self._generators, None)
            info |= last
        none, all_ = np.zeros(self.num_envs, dtype=np.bool_), np.full(self.num_envs, at_end)
        return observation, reward, none, all_, self._masked(info)

    def render(self) -> tuple[Pixels, ...] | None:
        return self._pictures()

    def _masked(self, info: Info) -> Info:
        """Gymnasium wants a mask with each value: which copies have it. Here all have it."""
        return info | {f"_{name}": np.ones(self.num_envs, dtype=np.bool_) for name in info}
