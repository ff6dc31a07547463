"""A task: its file, and its dynamics."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from importlib.resources.abc import Traversable
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from stlbench import contract, stl
from stlbench.errors import UsageError, did_you_mean
from stlbench.records.identity import Track
from stlbench.registry import named_tasks, plugins
from stlbench.registry.breaches import breach
from stlbench.registry.choices import Choice
from stlbench.registry.fingerprint import BY_HAND_FILE, TASK_FILE
from stlbench.registry.plugins import SuitePlugin
from stlbench.task.checks import check_regions, check_system, check_world
from stlbench.task.entry import Parts
from stlbench.task.file import Axis, Budget, TaskFile
from stlbench.task.reading import errors_of, read
from stlbench.task.starts import SeedStarts, StateStarts
from stlbench.task.view import FormulaView, bent_columns

if TYPE_CHECKING:
    from stlbench.task.gym_source import GymSource

Dynamics = contract.System | contract.GymTask | contract.WorldTask


@dataclass(frozen=True)
class Task:
    """A task that is ready: file, formulas in steps, system."""

    choice: Choice
    """The plugin, and the changes that an ablation makes: overlap[without=cuts]."""
    file: TaskFile
    dynamics: Dynamics
    """The thing that moves: a system, whose state can be set, or an environment or a world, whose starts are seeds."""
    lacking: tuple[str, ...] = ()
    """The parts that the choice leaves out and the file does not have. The track `auto` may derive it."""
    otherwise: stl.Formula | None = None
    """The form that methods are given if they do not take the specification's. The track `auto` derives it."""

    @property
    def left_out(self) -> tuple[str, ...]:
        """The parts that the choice leaves out."""
        return tuple(_left_out(self.choice))

    @property
    def system(self) -> contract.System:
        """The system, for code that sets its state. Raises `Unsuitable` if the task is none."""
        if isinstance(self.dynamics, contract.System):
            return self.dynamics
        raise contract.Unsuitable(f"task {self.name} is no system: its state cannot be set, its starts are seeds")

    @cached_property
    def starts(self) -> StateStarts | SeedStarts:
        if isinstance(self.dynamics, contract.System):
            return StateStarts(self.file, self.dynamics)
        return SeedStarts(self.file)

    @property
    def name(self) -> str:
        return str(self.choice)

    @property
    def formula(self) -> stl.Formula:
        return self.file.formula

    @cached_property
    def signals(self) -> tuple[str, ...]:
        return tuple(self.file.signals)

    @cached_property
    def actions(self) -> contract.Actions:
        """The grid of actions, or their box; those of the environment if the file has none."""
        # An environment may have an axis of one value beside others, which a file may not declare: not checked.
        declared = self.file.actions or {axis.name: Axis.model_construct(**axis.ends) for axis in self.source.axes}
        names, axes = tuple(declared), declared.values()
        if any(axis.count is None for axis in axes):
            return contract.ActionBox(names, tuple(axis.low for axis in axes), tuple(axis.high for axis in axes))
        robots = tuple(len(owned) for owned in self.file.robots.values())
        return contract.ActionGrid(names, tuple(axis.values for axis in axes), robots)

    @cached_property
    def source(self) -> GymSource:
        """The environment that the task is made on. Raises `UsageError` if the file does not fit it."""
        from stlbench.task.gym_source import source_of  # imports Gymnasium, which most tasks do without

        assert isinstance(self.dynamics, contract.GymTask)
        return source_of(self.name, self.file, self.dynamics)

    @cached_property
    def specification(self) -> contract.Specification:
        ranges = self.file.signals.values()
        return contract.Specification(
            formula=self.file.followed if self.file.rewarded is None else self.file.rewarded,
            signals=self.signals,
            low=tuple(signal.low for signal in ranges),
            high=tuple(signal.high for signal in ranges),
            steps=self.file.steps,
            dt=self.file.sampling_time,
            nested=self.file.nested,
            can_end=not isinstance(self.dynamics, contract.System),
        )

    @cached_property
    def view(self) -> FormulaView | None:
        """The policies' view of the formula, with `features: formula`."""
        if self.file.features != "formula":
            return None
        bent = self._bent(self.dynamics) if isinstance(self.dynamics, contract.System) else None
        return FormulaView(self.file.followed, self.file.box, self.file.steps, bent)

    def _bent(self, system: contract.System, copies: int = 16, decisions: int = 40) -> contract.Truth:
        """Which numbers of the state are more than the signals, on a random walk; all if it becomes NaN or infinite."""
        generator = np.random.default_rng(0)
        state = self.starts.of_training(generator, copies)
        states = [state]
        for _ in range(decisions):
            action = generator.uniform(self.actions.low, self.actions.high, (copies, len(self.actions.names)))
            for _ in range(self.file.hold):
                state = system.step(state, action)
            states.append(state)
        walked = np.concatenate(states)
        return bent_columns(system.scaled_state(walked), system.signals(walked))

    @property
    def own_agent(self) -> str:
        """The agent that the task is trained with unless another is named: the first that it has a recipe for.

        If a task has no recipes, the kind of its actions and the number of its robots say which.
        """
        return next(iter(self.file.agents), None) or agent_for(self.actions)

    @property
    def own_track(self) -> Track:
        return "shared" if self.file.agents else "auto"

    def budget(self, name: str) -> Budget:
        if name not in self.file.budgets:
            raise UsageError(f"task {self.name} has no budget '{name}'{did_you_mean(name, self.file.budgets)}")
        return self.file.budgets[name]

    def recipe(self, agent: str) -> Mapping[str, Any]:
        """The task's parameters for an agent, by the agent's name without parameters; none where it has no recipe."""
        return self.file.agents.get(agent, {})


def agent_for(actions: contract.Actions) -> str:
    """The agent that a task without recipes is trained with, by the kind of its actions and the number of robots."""
    return next(agents_for(actions))


def agents_for(actions: contract.Actions) -> Iterator[str]:
    """The agents to train with on actions of this kind, by their preference. The first is one of stlbench.

    Agents from outside are loaded after it: what is installed changes no study that names no agent.
    """
    installed = plugins.available("agents").values()
    if not (own := _by_place([plugin for plugin in installed if plugin.is_own], actions.kind)):
        raise UsageError(
            f"no agent of stlbench for actions of kind {actions.kind} can be loaded: see `stlbench list agents`"
        )
    first = own[0]
    yield first
    yield from (name for name in _by_place(installed, actions.kind) if name != first)


def _by_place(agents: Iterable[plugins.Plugin], kind: str) -> list[str]:
    found = list[tuple[int, bool, str]]()
    for plugin in agents:
        with suppress(plugins.PluginError):
            if (place := plugins.place(plugin.load(), kind)) is not None:
                found.append((place, not plugin.is_own, plugin.name))
    return [name for *_, name in sorted(found)]


def load_task(choice: Choice | str) -> Task:
    """Find, read and check a task.

    Args:
        choice: its name, or the path of its folder. A variant leaves parts out, holds its actions for another time, or
            follows one of its schedules: overlap[without=cuts+ends], robot-nav[hold=20], ./my-task[schedule=late].

    Raises:
        UsageError: there is no such task, or its file has errors (the message lists all of them). Or a variant leaves
            out something that is no part of a task, or holds actions for a number of steps that does not fit.
    """
    choice = named_tasks.task_of(choice)
    name = choice.name
    plugin = plugins.find("tasks", name)
    kind = plugin.load()
    text, by_hand = (plugin.file, None) if isinstance(plugin, SuitePlugin) else _texts(name, kind)
    reading = read(text, name, by_hand)
    errors = list(reading.errors)
    dynamics = None
    try:
        dynamics = _dynamics(plugin, reading.parts)
    except plugins.PluginError:
        raise
    except ImportError as error:
        if not errors:
            raise UsageError(f"task {name} cannot be loaded: {error}") from error
    except ValueError as error:
        errors.append(str(error))
    errors += _misfits(dynamics or kind, reading.parts)
    if errors or reading.file is None or dynamics is None:
        raise errors_of(name, errors, by_hand)
    varied = _varied(reading.file, choice)  # it knows all parts that are left out
    lacking = tuple(part for part in _left_out(choice) if _is_without(reading.file, part, dynamics))
    task = Task(choice, varied, dynamics, lacking)
    if isinstance(dynamics, contract.GymTask):
        _ = task.source  # checks the file against the environment
    return task


def _left_out(choice: Choice) -> list[str]:
    return [part for key, value in choice.parameters if key == "without" for part in value.split("+")]


def _is_without(file: TaskFile, part: str, dynamics: Dynamics) -> bool:
    """Whether a file is without a part. Only a system has features beyond its state."""
    return not file.has(part) or (part == "features" and not isinstance(dynamics, contract.System))


def _varied(file: TaskFile, choice: Choice) -> TaskFile:
    """The file with what the choice says."""
    for key, value in choice.parameters:
        try:
            if key == "without":
                for part in value.split("+"):
                    file = file.less(part)
            elif key == "hold":
                if _count(value) == file.hold:
                    raise ValueError(f"the task holds actions for {value} steps as it is")
                file = file.held(_count(value))
            elif key == "schedule":
                file = file.scheduled(value)
            else:
                raise ValueError(f"a task has no parameter '{key}', only without=cuts+ends, hold=2 and schedule=late")
        except ValueError as error:
            raise UsageError(f"{choice}: {error}") from error
    return file


def _count(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise ValueError(f"hold should be a whole number of steps, at least 1, got '{text}'")
    return int(text)


def _texts(name: str, kind: type) -> tuple[str, str | None]:
    """The texts of `task.yaml`, and of `by_hand.yaml` if there is one."""
    own = sys.modules.get(kind.__module__)
    package = kind.__module__ if hasattr(own, "__path__") else kind.__module__.rpartition(".")[0]
    if not package:
        raise UsageError(f"task {name}: {kind.__module__} is in no package; a task is a package with a task.yaml")
    place = named_tasks.place_of(name) or resources.files(package)
    text, by_hand = (_text(place.joinpath(file), name) for file in (TASK_FILE, BY_HAND_FILE))
    if text is None:
        raise UsageError(f"task {name}: there is no task.yaml in the package {package}")
    return text, by_hand


def _text(file: Traversable, name: str) -> str | None:
    try:
        return file.read_text(encoding="utf-8") if file.is_file() else None  # a pipe would be waited for
    except (OSError, UnicodeError) as error:
        raise UsageError(f"task {name}: {file.name} cannot be read: {error}") from error


def _dynamics(plugin: plugins.Plugin, parts: Parts) -> Dynamics | None:
    """The thing that moves, with the file's parameters; None if one of its entries is wrong. Raises `ValueError`."""
    if "parameters" not in parts:
        return None
    kind = plugin.load()
    try:
        keywords = plugins.check("tasks", Choice(plugin.name), parts["parameters"], origin="")
        if issubclass(kind, contract.System) and "sampling_time" not in parts:
            return None
        made = cast(
            Dynamics,
            kind(parts["sampling_time"], **keywords) if issubclass(kind, contract.System) else kind(**keywords),
        )
    except (TypeError, ValueError) as error:
        raise ValueError(f"parameters: {str(error).removeprefix(f'{plugin.name}: ')}") from error
    if problem := breach(made):
        raise plugin.error(problem)
    return made


def _misfits(dynamics: Dynamics | type[Dynamics], parts: Parts) -> Iterator[str]:
    """The file's entries for another kind of task; boxes of initial states use the names of the system's states."""
    kind = dynamics if isinstance(dynamics, type) else type(dynamics)
    if issubclass(kind, contract.System):
        system = cast(contract.System | type[contract.System], dynamics)
        yield from check_system(parts)
        yield from check_regions(parts, system.state if system.coordinates is None else system.coordinates)
    else:
        yield from check_world(parts, on_gymnasium=issubclass(kind, contract.GymTask))
